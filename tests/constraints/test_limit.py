import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from constraints import Limit, LimitDefinition, limit_definitions

INF = np.inf


def _limit(key, lower, upper):
    lower, upper = np.atleast_1d(np.array(lower, float)), np.atleast_1d(np.array(upper, float))
    labels = tuple(f"row {k}" for k in range(lower.size))
    return Limit(limit_definitions()[key], lower, upper, labels, "here")


@pytest.fixture
def mixed():
    """Rows: an interval, above only, below only, open, bounded at zero."""
    return _limit("position", [-1, -INF, 0.2, -INF, 0, -INF], [3, 0.5, INF, INF, INF, 0])


def test_name_and_unit():
    limit = _limit("tilt", -INF, 0.3)
    assert (limit.key, limit.unit) == ("tilt", "rad")


# --- range, violation, nearest bound --------------------------------------------------------------


def test_range(mixed):
    np.testing.assert_array_equal(mixed.range, [4, 0.5, 0.2, 1, 1, 1])


def test_range_of_equal_bounds_is_their_size():
    np.testing.assert_array_equal(_limit("position", [2, 0], [2, 0]).range, [2, 1])


def test_range_of_symmetric_bounds_is_their_width():
    np.testing.assert_array_equal(_limit("strut_speed", [-2.0], [2.0]).range, [4])


def test_violation(mixed):
    kept = mixed.violation(np.array([1, 0.4, 0.3, 1e9, 1, -1.0]))
    np.testing.assert_allclose(kept, [-0.5, -0.2, -0.5, -INF, -1, -1])
    broken = mixed.violation(np.array([3.4, 0.6, 0.1, -1e9, -2, 0.1]))
    np.testing.assert_allclose(broken, [0.1, 0.2, 0.5, -INF, 2, 0.1])
    assert mixed.violation(np.array([-1.4, 0, 1, 0, 0, 0]))[0] == pytest.approx(0.1)


def test_violation_of_many_instants(mixed):
    values = np.random.default_rng(0).normal(size=(7, 4, 6))
    violations = mixed.violation(values)
    assert violations.shape == values.shape
    np.testing.assert_array_equal(violations[3, 2], mixed.violation(values[3, 2]))
    for row in range(6):
        assert mixed.violation_of(row, values[3, 2, row]) == violations[3, 2, row]


def test_at_the_bound_is_kept(mixed):
    assert np.all(mixed.violation(np.array([3, 0.5, 0.2, 0, 0, 0])) <= 0)
    assert mixed.violation_of(0, -1.0) == 0
    assert mixed.violation_of(0, 3.0) == 0


def test_nearest_bound(mixed):
    assert mixed.nearest_bound(0, 2.9) == 3
    assert mixed.nearest_bound(0, 5.0) == 3
    assert mixed.nearest_bound(0, 0.9) == -1
    assert mixed.nearest_bound(0, -7.0) == -1
    assert mixed.nearest_bound(1, -50) == 0.5
    assert mixed.nearest_bound(2, 50) == 0.2
    assert np.isinf(mixed.nearest_bound(3, 0.0))


@given(
    st.floats(-1e3, 1e3),
    st.floats(1e-3, 1e3),
    st.floats(-5e3, 5e3),
)
def test_violation_is_the_distance_to_the_nearest_bound(low, width, value):
    limit = _limit("position", low, low + width)
    violation = limit.violation_of(0, value)
    distance = abs(value - limit.nearest_bound(0, value)) / limit.range[0]
    assert abs(violation) == pytest.approx(distance, rel=1e-9, abs=1e-12)
    assert (violation > 0) == (value < low or value > low + width)


# --- reserve --------------------------------------------------------------------------------------


def test_a_reserve_draws_the_bounds_in(mixed):
    drawn = mixed.with_reserve(0.1)
    np.testing.assert_allclose(drawn.lower, [-0.6, -INF, 0.22, -INF, 0, -INF])
    np.testing.assert_allclose(drawn.upper, [2.6, 0.45, INF, INF, INF, 0])
    assert drawn.reserve == 0.1
    for found, stated in zip(drawn.stated_bounds, (mixed.lower, mixed.upper), strict=True):
        np.testing.assert_array_equal(found, stated)
    np.testing.assert_array_equal(drawn.open_rows, mixed.open_rows)
    assert drawn.nearest_bound(0, 2.5) == pytest.approx(2.6)
    assert drawn.nearest_bound(0, 2.5, stated=True) == 3
    assert drawn.nearest_bound(0, -0.5, stated=True) == -1


def test_a_reserve_is_of_the_stated_range(mixed):
    twice = mixed.with_reserve(0.3).with_reserve(0.1)
    np.testing.assert_array_equal(twice.lower, mixed.with_reserve(0.1).lower)
    back = twice.with_reserve(0.0)
    for found in (mixed.with_reserve(0.0), back):
        assert found.reserve == 0
        np.testing.assert_array_equal(found.lower, mixed.lower)
        np.testing.assert_array_equal(found.upper, mixed.upper)


# --- bounds of the smooth form --------------------------------------------------------------------


def _both(limit, margin=0.0):
    return tuple(float(side[0]) for side in limit.smooth_bounds(margin))


def test_bounds_of_an_increasing_transform():
    assert _both(_limit("beta", -0.5, 1.0)) == pytest.approx((np.sin(-0.5), np.sin(1.0)))


def test_bounds_of_a_decreasing_transform_swap():
    assert _both(_limit("tilt", -INF, 0.3)) == pytest.approx((np.cos(0.3), INF))
    assert _both(_limit("tilt", 0.1, INF)) == pytest.approx((-INF, np.cos(0.1)))
    assert _both(_limit("tilt", 0.1, 0.3)) == pytest.approx((np.cos(0.3), np.cos(0.1)))
    assert _both(_limit("platform_joint_angle", -INF, 0.7)) == pytest.approx((np.cos(0.7), INF))


def test_bounds_that_are_absent_stay_absent():
    for key in limit_definitions():
        assert _both(_limit(key, -INF, INF)) == (-INF, INF)


def test_other_transforms():
    assert _both(_limit("strut_clearance", 0.015, INF)) == pytest.approx((0.015**2, INF))
    assert _both(_limit("jacobian_condition", -INF, 10)) == pytest.approx((-INF, 2 * np.log(10)))
    assert _both(_limit("strut_speed", -2, 2)) == (-2, 2)


def test_margins_draw_the_natural_bounds_in():
    assert _both(_limit("strut_speed", -2, 2), 0.1) == pytest.approx((-1.6, 1.6))
    assert _both(_limit("beta", -0.5, 1.0), 0.1) == pytest.approx((np.sin(-0.35), np.sin(0.85)))
    assert _both(_limit("tilt", -INF, 0.3), 0.1) == pytest.approx((np.cos(0.27), INF))
    assert _both(_limit("strut_clearance", 0.02, INF), 0.1) == pytest.approx((0.022**2, INF))


def test_margins_by_row_and_by_instant():
    limit = _limit("strut_speed", [-2] * 6, [2] * 6)
    margins = np.linspace(0, 0.2, 30).reshape(5, 6)
    lower, upper = limit.smooth_bounds(margins)
    assert lower.shape == upper.shape == (5, 6)
    np.testing.assert_allclose(upper, 2 - 4 * margins)
    np.testing.assert_allclose(lower, -2 + 4 * margins)


@given(
    st.sampled_from(["beta", "tilt", "platform_joint_angle", "strut_clearance"]),
    st.floats(0.05, 1.4),
    st.floats(0.05, 1.4),
    st.floats(0, 0.4),
)
def test_a_value_within_the_drawn_bounds_is_within_the_smooth_ones(key, one, other, margin):
    low, high = sorted((one, other))
    limit = _limit(key, low, high + 1e-3)
    lower, upper = _both(limit, margin)
    for share in np.linspace(0, 1, 11):
        value = low + share * (high + 1e-3 - low)
        within = limit.violation_of(0, value) <= -margin
        there = float(limit.definition.transform(np.array(value)))
        if abs(limit.violation_of(0, value) + margin) > 1e-9:
            assert (lower <= there <= upper) is within


def test_definitions_cannot_be_changed():
    definition = limit_definitions()["tilt"]
    with pytest.raises(AttributeError):
        definition.key = "other"
    with pytest.raises(TypeError):
        limit_definitions()["other"] = definition
    assert isinstance(definition, LimitDefinition)


# --- share used -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "lower", "upper", "value", "share"),
    [
        ("strut_speed", -2, 2, -1.2, 0.6),  # ±b: |value| / b
        ("tilt", -INF, 0.5, 0.3, 0.6),  # upper bound: value / bound
        ("strut_clearance", 0.01, INF, 0.04, 0.25),  # lower bound: bound / value
        ("strut_clearance", 0, INF, 0.04, 0.96),  # of no size, or negative: by the violation
        ("strut_clearance", -0.5, INF, -0.4, 0.8),
        ("position", 0.2, 0.6, 0.55, 0.75),  # range: from its middle
        ("position", 0.2, 0.6, 0.25, 0.75),
        ("actuator_force", -100, 100, 110, 1.1),
    ],
)
def test_share_used(key, lower, upper, value, share):
    limit = _limit(key, lower, upper)
    bound, violation = limit.nearest_bound(0, value), limit.violation_of(0, value)
    used = limit.definition.shares_used(*np.array([value, bound, violation]))
    assert used == pytest.approx(share)
