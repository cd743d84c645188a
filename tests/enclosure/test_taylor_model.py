"""Sums, products and bounds of Taylor models against the same in 60 digits."""

import operator
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from expdesign.enclosure.taylor_model import TERMS, TaylorModel
from tests.enclosure.exact import CELLS, TIMES, assert_holds, members


@pytest.fixture(autouse=True)
def overflowing():
    """What overflows is unknown: no warning is needed of it."""
    with np.errstate(all="ignore"):
        yield


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul])
@given(a=members(), b=members(), cell=CELLS, time=TIMES)
def test_what_two_models_make_holds_what_their_functions_make(operation, a, b, cell, time):
    found = operation(a.model, b.model)

    assert len(found.coefficients) <= TERMS
    assert_holds(found, cell, time, operation(a.at(cell, time), b.at(cell, time)))


@given(a=members(), cell=CELLS, time=TIMES, factor=st.floats(-1e3, 1e3))
def test_what_one_model_makes_holds_what_its_function_makes(a, cell, time, factor):
    value = a.at(cell, time)

    assert_holds(-a.model, cell, time, -value)
    assert_holds(a.model.squared(), cell, time, value * value)
    assert_holds(TaylorModel.number(factor) * a.model, cell, time, value * Fraction(factor))
    assert_holds(a.model, cell, time, value)
    size = np.broadcast_to(a.model.size, (2,))[cell]
    assert not np.isfinite(size) or abs(value) <= Fraction(float(size))


@given(
    low=st.floats(allow_nan=False),
    width=st.floats(0, np.inf),
    share=st.floats(0, 1),
    cell=CELLS,
    time=TIMES,
)
def test_what_lies_between_two_numbers_is_held(low, width, share, cell, time):
    high = low + width
    model = TaylorModel.within(np.full(2, low), np.full(2, high))

    if not (np.isfinite(low) and np.isfinite(high)):
        assert np.all(np.isinf(model.radius))
        return
    for value in (low, high, min(high, low + share * width)):
        assert_holds(model, cell, time, Fraction(value))


def test_the_vertex_of_numbers_whose_squares_vanish_is_within_the_bounds():
    tiny = 2.0**-540
    model = TaylorModel(np.array([[0.0], [-tiny], [tiny]]), np.zeros(1))

    low, _ = model.bounds()

    assert low[0] <= -tiny / 4


@pytest.mark.parametrize("coefficients", [[1.0, 1e200], [1e200, 1.0], [1.0, 0.0, -1e200]])
def test_of_what_is_too_large_for_a_number_nothing_is_known(coefficients):
    model = TaylorModel(np.array(coefficients)[:, None], np.zeros(1)).squared()

    for found in (model, model.squared(), model * TaylorModel.number(2.0) - model):
        low, high = found.bounds()
        assert (low[0], high[0]) == (-np.inf, np.inf)


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul])
def test_sums_and_products_of_exact_polynomials_are_no_wider_than_rounding(operation):
    a = TaylorModel(np.array([[1.0], [0.25], [0.5]]), np.zeros(1))

    assert operation(a, a).radius[0] < 1e-13


@given(a=members(st.floats(-1e3, 1e3)), cell=CELLS)
def test_bounds_are_as_narrow_as_the_polynomial_up_to_its_square(a, cell):
    coefficients = np.broadcast_to(a.model.coefficients, (len(a.model.coefficients), 2))[:, cell]
    low, high = (np.broadcast_to(one, (2,))[cell] for one in a.model.bounds())
    size = np.sum(np.abs(coefficients))
    rest = np.sum(np.abs(coefficients[3:])) + np.broadcast_to(a.model.radius, (2,))[cell]
    values = np.polynomial.polynomial.polyval(np.linspace(-1, 1, 2001), coefficients[:3])

    # A vertex between two of 2001 points is higher by a part in four millions at most.
    assert high - np.max(values) <= rest * (1 + 1e-9) + 1e-6 * size + 1e-299
    assert np.min(values) - low <= rest * (1 + 1e-9) + 1e-6 * size + 1e-299


@pytest.mark.parametrize("place", [-0.9, -0.3, 0.0, 0.7])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sign_change_is_found(place, sign):
    """Of (τ − place)(2 + τ²), beside a polynomial without one."""
    known = sign * np.array([-2 * place, 2.0, -place, 1.0])
    model = TaylorModel(np.column_stack([known, [3.0, 1.0, 1.0, 0.0]]), np.zeros(1))

    found = model.root()

    assert found[0] == pytest.approx(place, abs=1e-6)
    assert np.isnan(found[1])
