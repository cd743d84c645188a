"""Models drawn at random, functions that they stand for, and their exact values."""

from dataclasses import dataclass
from fractions import Fraction

import mpmath
import numpy as np
from hypothesis import strategies as st

from expdesign.enclosure.taylor_model import TERMS, TaylorModel

mpmath.mp.dps = 60
"""Far more than the 16 digits that are tried."""
_COMPUTED = Fraction(1, 10**50)
"""Share by which a value of that many digits may be wrong."""

_USUAL = st.floats(-4.0, 4.0)
_ANY = st.floats(allow_nan=False, allow_infinity=False)
_SMALL = st.floats(-1e-3, 1e-3)
COEFFICIENTS = st.one_of(_USUAL, _SMALL, st.sampled_from([0.0, 1.0, -1.0]), _ANY)
TIMES = st.one_of(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-1.0, 1.0))
CELLS = st.integers(0, 1)
_OFF = st.one_of(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-1.0, 1.0))


@dataclass(frozen=True, repr=False)
class Member:
    """A model over two cells, and in each a function that it stands for: P(τ) + share · radius."""

    model: TaylorModel
    share: float

    def __repr__(self) -> str:
        return f"{self.model.coefficients.tolist()} ± {self.model.radius.tolist()} · {self.share}"

    def at(self, cell: int, time: float) -> Fraction:
        """Return the function's value at τ in a cell, exact."""
        radius = Fraction(float(np.broadcast_to(self.model.radius, (2,))[cell]))
        return polynomial(self.model, cell, time) + Fraction(self.share) * radius

    def digits(self, cell: int, time: float) -> mpmath.mpf:
        """Return the same in many digits."""
        return digits(self.at(cell, time))


def digits(value: Fraction) -> mpmath.mpf:
    """Return a number in many digits."""
    return mpmath.mpf(value.numerator) / value.denominator


def polynomial(model: TaylorModel, cell: int, time: float) -> Fraction:
    """Return the polynomial's value at τ in a cell, exact."""
    tau, value = Fraction(time), Fraction(0)
    for coefficient in _column(model, cell)[::-1]:
        value = value * tau + Fraction(float(coefficient))
    return value


@st.composite
def members(draw, coefficients=COEFFICIENTS):
    """Draw a model and a function in it; sometimes one column stands for both cells."""
    cells = draw(st.sampled_from([1, 2, 2]))
    count = draw(st.integers(1, TERMS))
    values = [[draw(coefficients) for _ in range(cells)] for _ in range(count)]
    sizes = st.one_of(st.just(0.0), st.floats(0, 1e-2), coefficients.map(abs))
    radius = [draw(sizes) for _ in range(draw(st.sampled_from([1, cells])))]
    return Member(TaylorModel(np.array(values), np.array(radius)), draw(_OFF))


@st.composite
def around(draw, low, high, spread=1.0):
    """Draw a model about a number between two others, and a function in it."""
    size = draw(st.sampled_from([0.0, 1e-12, 1e-6, 1e-2, 1.0])) * spread
    small = st.floats(-size, size)
    values = np.array([[draw(small) for _ in range(2)] for _ in range(draw(st.integers(1, TERMS)))])
    values[0] += draw(st.floats(low, high))
    radius = np.abs([draw(small) for _ in range(2)]) * draw(st.sampled_from([0.0, 1e-9, 0.1]))
    return Member(TaylorModel(values, radius), draw(_OFF))


def assert_holds(model: TaylorModel, cell: int, time: float, value: Fraction | mpmath.mpf) -> None:
    """Assert that a value at τ in a cell is one that the model admits, and within its bounds."""
    low, high = (np.broadcast_to(one, (2,))[cell] for one in model.bounds())
    radius = float(np.broadcast_to(model.radius, (2,))[cell])
    assert radius >= 0
    if not np.isfinite(radius):
        assert not low > -np.inf
        assert not high < np.inf
        return
    assert np.all(np.isfinite(_column(model, cell)))
    rounding = Fraction(0)
    if isinstance(value, mpmath.mpf):
        value = Fraction(*mpmath.libmp.to_rational(value._mpf_))
        rounding = abs(value) * _COMPUTED
    assert abs(value - polynomial(model, cell, time)) <= Fraction(radius) + rounding
    assert not np.isfinite(low) or Fraction(float(low)) <= value + rounding
    assert not np.isfinite(high) or value - rounding <= Fraction(float(high))


def _column(model, cell):
    return np.broadcast_to(model.coefficients, (len(model.coefficients), 2))[:, cell]
