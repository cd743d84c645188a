"""Functions of Taylor models against the same in 60 digits."""

from fractions import Fraction

import casadi as ca
import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from expdesign.enclosure import taylor_model as f
from expdesign.enclosure.instructions import EnclosedFunction, NoEnclosureError
from expdesign.enclosure.taylor_model import TERMS, TaylorModel
from tests.enclosure.exact import CELLS, TIMES, around, assert_holds, digits, members

SMOOTH = {
    "sine": (f.sine, mpmath.sin, (-10.0, 10.0)),
    "cosine": (f.cosine, mpmath.cos, (-10.0, 10.0)),
    "exponential": (f.exponential, mpmath.exp, (-50.0, 5.0)),
    "reciprocal": (f.reciprocal, lambda x: 1 / x, (0.3, 1e3)),
    "root": (f.root, mpmath.sqrt, (0.3, 1e3)),
    "arc sine": (f.arc_sine, mpmath.asin, (-0.9, 0.9)),
    "arc cosine": (f.arc_cosine, mpmath.acos, (-0.9, 0.9)),
}

_X, _Y = ca.SX.sym("x"), ca.SX.sym("y")
IN_ORDER = EnclosedFunction([_X, _Y], [ca.fmax(_X, _Y), ca.fmin(_X, _Y)])


@pytest.fixture(autouse=True)
def overflowing():
    """What is not known is infinite: no warning is needed of it."""
    with np.errstate(all="ignore"):
        yield


@pytest.mark.parametrize("name", SMOOTH)
@given(data=st.data(), cell=CELLS, time=TIMES)
def test_a_function_of_a_model_holds_that_of_its_function(name, data, cell, time):
    function, exact, (low, high) = SMOOTH[name]
    a = data.draw(around(low, high, 0.2))
    x = a.digits(cell, time)
    if name in ("reciprocal", "root"):
        assume(x > 0)
    if name.startswith("arc"):
        assume(abs(x) <= 1)

    assert_holds(function(a.model), cell, time, exact(x))


@pytest.mark.parametrize("name", SMOOTH)
@given(data=st.data(), cell=CELLS, time=TIMES)
def test_a_function_of_any_model_holds_that_of_its_function(name, data, cell, time):
    function, exact, _ = SMOOTH[name]
    widest = {"arc sine": 0.3, "arc cosine": 0.3, "exponential": 100.0}.get(name, 1e6)
    a = data.draw(members(st.floats(-widest, widest)))
    x = a.digits(cell, time)
    assume(name != "reciprocal" or x != 0)
    assume(name != "root" or x > 0)
    assume(not name.startswith("arc") or abs(x) <= 1)

    assert_holds(function(a.model), cell, time, exact(x))


@pytest.mark.parametrize("name", SMOOTH)
def test_a_function_of_a_narrow_model_is_narrow(name):
    function, _, (low, high) = SMOOTH[name]
    middle = np.linspace(low, min(high, 20.0), 9)
    c = np.zeros((TERMS, 9))
    c[0], c[1], c[2] = middle, 1e-3, -1e-4

    found = function(TaylorModel(c, np.zeros(1)))

    assert np.all(found.radius <= 1e-9 * np.abs(found.coefficients).sum(axis=0))


@given(y=around(-2.0, 2.0), x=around(-2.0, 2.0), cell=CELLS, time=TIMES)
def test_the_angle_of_a_point_is_held(y, x, cell, time):
    at = y.digits(cell, time), x.digits(cell, time)
    assume(at != (0, 0))

    assert_holds(f.arc_tangent(y.model, x.model), cell, time, mpmath.atan2(*at))


def test_an_angle_that_may_jump_by_a_turn_is_any_angle():
    across = TaylorModel(np.array([[0.0], [1e-3]]), np.zeros(1))

    low, high = f.arc_tangent(across, TaylorModel.number(-1.0)).bounds()

    assert low[0] < -np.pi
    assert high[0] > np.pi


@given(a=members(), b=members(), cell=CELLS, time=TIMES)
def test_quotients_signs_and_sizes_hold(a, b, cell, time):
    x, y = a.at(cell, time), b.at(cell, time)

    assert_holds(f.sign(a.model), cell, time, type(x)((x > 0) - (x < 0)))
    assert_holds(f.absolute(a.model), cell, time, abs(x))
    (larger,), (smaller,) = IN_ORDER([[a.model], [b.model]])
    assert_holds(larger, cell, time, max(x, y))
    assert_holds(smaller, cell, time, min(x, y))
    if y != 0:
        assert_holds(f.divide(a.model, b.model), cell, time, x / y)


@given(a=around(-2.0, 2.0), b=around(-2.0, 2.0), cell=CELLS, time=TIMES)
def test_sizes_and_the_larger_of_two_that_cross_hold(a, b, cell, time):
    x, y = a.at(cell, time), b.at(cell, time)

    assert_holds(f.absolute(a.model), cell, time, abs(x))
    (larger,), (smaller,) = IN_ORDER([[a.model], [b.model]])
    assert_holds(larger, cell, time, max(x, y))
    assert_holds(smaller, cell, time, min(x, y))


@pytest.mark.parametrize("time", np.linspace(-1, 1, 9))
@pytest.mark.parametrize("cell", [0, 1])
def test_the_larger_of_two_lines_that_cross_holds_far_from_where_they_do(cell, time):
    rising = TaylorModel(np.array([[0.0, 0.25], [1.0, 1.0]]), np.zeros(1))
    falling = TaylorModel(np.array([[0.0, 0.0], [-1.0, -2.0]]), np.zeros(1))
    values = [0.25 * cell + time, -(1 + cell) * time]

    (larger,), (smaller,) = IN_ORDER([[rising], [falling]])

    assert_holds(larger, cell, time, Fraction(max(values)))
    assert_holds(smaller, cell, time, Fraction(min(values)))


@given(a=members(st.floats(-2, 2)), b=members(st.floats(-2, 2)), cell=CELLS, time=TIMES)
def test_each_cell_has_the_model_that_is_chosen_for_it(a, b, cell, time):
    which = np.array([True, False])

    found = f.select_cells(which, a.model, b.model)

    assert_holds(found, cell, time, (a if which[cell] else b).at(cell, time))


@pytest.mark.parametrize("function", [f.reciprocal, f.root, f.exponential, f.sine, f.absolute])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_of_what_is_unknown_a_function_tells_nothing_wrong(function, bad):
    # The other cell is known, and stays so.
    a = TaylorModel(np.array([[bad, 2.0], [0.0, 0.1]]), np.array([np.inf, 0.0]))

    found = function(a)
    low, high = found.bounds()

    assert not high[0] < 0.99
    assert not low[0] > -np.inf
    assert np.isfinite(low[1])
    assert np.isfinite(high[1])


def test_a_root_near_zero_is_between_zero_and_that_of_the_largest():
    a = TaylorModel(np.array([[1e-6], [1e-6]]), np.zeros(1))

    low, high = f.root(a).bounds()

    assert low[0] == pytest.approx(0, abs=1e-12)
    assert np.sqrt(2e-6) <= high[0] < 1.001 * np.sqrt(2e-6)


UNARY = {
    "negative": (lambda x: -x, lambda x: -x),
    "square": (lambda x: x * x, lambda x: x * x),
    "twice": (lambda x: 2 * x, lambda x: 2 * x),
    "inverse": (lambda x: 1 / x, lambda x: 1 / x),
    "root": (ca.sqrt, mpmath.sqrt),
    "sin": (ca.sin, mpmath.sin),
    "cos": (ca.cos, mpmath.cos),
    "tan": (ca.tan, mpmath.tan),
    "asin": (ca.asin, mpmath.asin),
    "acos": (ca.acos, mpmath.acos),
    "atan": (ca.atan, mpmath.atan),
    "exp": (ca.exp, mpmath.exp),
    "sign": (ca.sign, mpmath.sign),
    "fabs": (ca.fabs, abs),
}


def _of_digits(function):
    """A function of many digits, taking exact numbers. A difference of digits has fewer."""
    return lambda *exact: function(*map(digits, exact))


BINARY = {
    "add": (lambda x, y: x + y, lambda x, y: x + y),
    "sub": (lambda x, y: x - y, lambda x, y: x - y),
    "mul": (lambda x, y: x * y, lambda x, y: x * y),
    "div": (lambda x, y: x / y, lambda x, y: x / y),
    "atan2": (ca.atan2, _of_digits(mpmath.atan2)),
    "hypot": (ca.hypot, _of_digits(mpmath.hypot)),
    "fmin": (ca.fmin, min),
    "fmax": (ca.fmax, max),
}


@pytest.mark.parametrize("name", UNARY)
@given(a=around(0.2, 0.7, 0.02), cell=CELLS, time=TIMES)
def test_an_instruction_of_one_number_is_the_one_that_casadi_means(name, a, cell, time):
    symbolic, exact = UNARY[name]
    x = ca.SX.sym("x")

    [[found]] = EnclosedFunction([x], [symbolic(x)])([[a.model]])

    assert_holds(found, cell, time, exact(a.digits(cell, time)))
    assert np.all(np.isfinite(found.radius))


@pytest.mark.parametrize("name", BINARY)
@given(a=around(0.2, 0.7, 0.02), b=around(0.2, 0.7, 0.02), cell=CELLS, time=TIMES)
def test_an_instruction_of_two_numbers_is_the_one_that_casadi_means(name, a, b, cell, time):
    symbolic, exact = BINARY[name]
    x, y = ca.SX.sym("x"), ca.SX.sym("y")

    [[found]] = EnclosedFunction([x, y], [symbolic(x, y)])([[a.model], [b.model]])

    assert_holds(found, cell, time, exact(a.at(cell, time), b.at(cell, time)))
    assert np.all(np.isfinite(found.radius))


def test_an_operation_without_enclosure_is_refused():
    x = ca.SX.sym("x")

    with pytest.raises(NoEnclosureError):
        EnclosedFunction([x], [ca.erf(x)])


def test_outputs_that_are_not_wanted_are_left_out_and_the_others_are_the_same():
    x = ca.SX.sym("x", 3)
    outputs = [ca.vertcat(x[0] * x[1], ca.sin(x[2])), x[0] * x[1] + x[2], ca.sqrt(x[1])]
    function = EnclosedFunction([x], outputs)
    models = [TaylorModel(np.full((2, 4), value), np.zeros(1)) for value in (0.5, 1.5, 2.5)]

    every, some = function([models]), function([models], [1])

    assert [len(part) for part in some] == [0, 1, 0]
    assert np.array_equal(every[1][0].coefficients, some[1][0].coefficients)


def test_numpy_is_as_accurate_as_the_enclosures_take_for_granted():
    values = np.concatenate(
        [np.linspace(-20, 20, 2001), np.pi / 2 * np.arange(-40, 41), 10.0 ** np.arange(-12, 5)]
    )
    for function, exact, asked in (
        (np.sin, mpmath.sin, lambda _: 8),
        (np.cos, mpmath.cos, lambda _: 8),
        (np.exp, mpmath.exp, lambda value: 8 * abs(value)),
        (np.sqrt, lambda x: mpmath.sqrt(abs(x)), lambda value: abs(value) / 2),
    ):
        used = np.minimum(values, 700.0) if function is np.exp else values
        used = np.abs(used) if function is np.sqrt else used
        computed = function(used)
        for x, y in zip(used, computed, strict=True):
            wrong = abs(mpmath.mpf(float(y)) - exact(mpmath.mpf(float(x))))
            assert wrong <= asked(float(y)) * 2.0**-52 + 1e-300
