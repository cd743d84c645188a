"""Slacks, their bounds and their multipliers."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from expdesign.solver import barrier
from expdesign.solver.barrier import Bounds, Duals
from tests.solver.programs import INF

LOWER = np.array([-1.0, -INF, 0.0, -INF])
UPPER = np.array([1.0, 2.0, INF, INF])
CLOSE = 0.9
MU = 0.03


def bounds():
    empty = np.empty(0)
    return Bounds.of(SimpleNamespace(lower=empty, upper=empty, row_lower=LOWER, row_upper=UPPER))


VALUES = arrays(float, 4, elements=st.floats(-5, 5))
SLACKS = st.tuples(
    st.floats(-0.999, 0.999), st.floats(-5, 1.999), st.floats(0.001, 5), st.floats(-5, 5)
).map(np.array)


@given(VALUES, SLACKS, SLACKS)
def test_a_slack_follows_its_row_only_where_this_stays_away_from_its_bounds(values, slacks, after):
    found = barrier.try_slacks(bounds(), values, slacks, after - slacks, CLOSE, True).slacks
    for k in range(4):
        below = np.isinf(LOWER[k]) or values[k] - LOWER[k] >= (1 - CLOSE) * (slacks[k] - LOWER[k])
        above = np.isinf(UPPER[k]) or UPPER[k] - values[k] >= (1 - CLOSE) * (UPPER[k] - slacks[k])
        assert found[k] == pytest.approx(values[k] if below and above else after[k], abs=1e-12)
    assert np.all((found > LOWER) & (found < UPPER))


@given(VALUES, SLACKS)
def test_a_trial_knows_its_barrier_and_how_far_slacks_are_from_their_values(values, slacks):
    found = barrier.try_slacks(bounds(), values, slacks, np.zeros(4), CLOSE, False)
    np.testing.assert_array_equal(found.slacks, slacks)
    gaps = np.concatenate([slacks - LOWER, UPPER - slacks])
    expected = np.sum(np.log(gaps[np.isfinite(gaps)]))
    assert found.logarithms == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert found.distance == pytest.approx(np.sum(np.abs(values - slacks)))


@given(SLACKS)
def test_rounding_never_leaves_a_slack_on_its_bound(slacks):
    on = np.where(np.isfinite(UPPER), UPPER, np.where(np.isfinite(LOWER), LOWER, slacks))
    found = barrier.try_slacks(bounds(), on, slacks, on - slacks, CLOSE, False)
    assert np.all((found.slacks > LOWER) & (found.slacks < UPPER))
    assert np.isfinite(found.logarithms)


def _newton(values, slacks, duals, hessian, gradient, jacobian):
    """The step of x, slacks and multipliers from all conditions of the central path, linearised."""
    size, count = len(gradient), len(slacks)
    gaps = slacks - LOWER, UPPER - slacks
    bounded = [np.isfinite(gap) for gap in gaps]
    gaps = [np.where(there, gap, 0.0) for there, gap in zip(bounded, gaps, strict=True)]
    zero, one = np.zeros((count, count)), np.eye(count)
    none = np.zeros((count, size))
    # Where there is no bound its multiplier is zero, and stays so.
    own = [np.diag(np.where(there, gap, 1.0)) for there, gap in zip(bounded, gaps, strict=True)]
    system = np.block(
        [
            [hessian, none.T, jacobian.T, none.T, none.T],
            [none, zero, -one, -one, one],
            [jacobian, -one, zero, zero, zero],
            [none, np.diag(duals.lower), zero, own[0], zero],
            [none, -np.diag(duals.upper), zero, zero, own[1]],
        ]
    )
    right = -np.concatenate(
        [
            gradient + jacobian.T @ duals.values,
            duals.upper - duals.lower - duals.values,
            values - slacks,
            np.where(bounded[0], duals.lower * gaps[0] - MU, 0.0),
            np.where(bounded[1], duals.upper * gaps[1] - MU, 0.0),
        ]
    )
    return np.split(np.linalg.solve(system, right), size + count * np.arange(4))


@given(VALUES, SLACKS, st.integers(0, 2**32 - 1))
def test_the_condensed_step_is_newtons_of_all_conditions(values, slacks, seed):
    rng, both = np.random.default_rng(seed), bounds()
    jacobian, root = rng.normal(size=(4, 3)), rng.normal(size=(3, 3))
    hessian, gradient = root @ root.T + np.eye(3), rng.normal(size=3)
    push = barrier.barrier_multipliers(both, slacks, MU)
    scatter = np.exp(0.5 * rng.normal(size=(2, 4)))
    duals = Duals(rng.normal(size=4), push.lower * scatter[0], push.upper * scatter[1])
    curvature, multipliers = barrier.eliminate_slacks(both, values, slacks, duals, MU)
    matrix = hessian + jacobian.T @ np.diag(curvature) @ jacobian
    x = np.linalg.solve(matrix, -(gradient + jacobian.T @ multipliers))
    moved = jacobian @ x + values - slacks
    found = barrier.slack_step(both, slacks, duals, moved, MU, CLOSE)
    expected = _newton(values, slacks, duals, hessian, gradient, jacobian)
    for one, other in zip((x, found.change, *found.duals), expected, strict=True):
        # Multipliers next to a bound are large.
        scale = 1 + np.max(np.abs(np.concatenate(expected)))
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8 * scale)


@given(SLACKS, arrays(float, 4, elements=st.floats(-3, 3)))
def test_a_step_leaves_something_of_every_distance_and_of_every_multiplier(slacks, moved):
    both = bounds()
    duals = barrier.barrier_multipliers(both, slacks, 1.0)
    step = barrier.slack_step(both, slacks, duals, moved, MU, CLOSE)
    there = slacks + step.share * moved
    kept = np.concatenate(
        [
            (there - bound)[np.isfinite(bound)] / (slacks - bound)[np.isfinite(bound)]
            for bound in (LOWER, UPPER)
        ]
    )
    assert np.min(kept) >= (1 - CLOSE) * (1 - 1e-9)
    # No shorter than it must be.
    assert step.share == 1 or np.min(kept) <= (1 - CLOSE) * (1 + 1e-6)
    both_duals = np.concatenate([duals.lower, duals.upper])
    changes = np.concatenate([step.duals.lower, step.duals.upper])[both_duals > 0]
    both_duals = both_duals[both_duals > 0]
    kept = (both_duals + step.dual_share * changes) / both_duals
    assert np.min(kept) >= (1 - CLOSE) * (1 - 1e-9)
    assert step.dual_share == 1 or np.min(kept) <= (1 - CLOSE) * (1 + 1e-6)
    ahead, behind = (
        barrier.try_slacks(both, slacks, slacks, sign * 1e-7 * moved, CLOSE, False).logarithms
        for sign in (1, -1)
    )
    size = 1e-4 * (1 + np.sum(np.abs(moved) * (duals.lower + duals.upper) ** 2))
    assert step.slope == pytest.approx(-MU * (ahead - behind) / 2e-7, abs=size)


@given(SLACKS, SLACKS, st.floats(-14, 14), st.floats(0.1, 1))
def test_multipliers_stay_near_what_the_barrier_pushes_with(slacks, there, decades, share):
    """Between a ten thousand millionth of it and as many times as much."""
    both = bounds()
    push = barrier.barrier_multipliers(both, there, MU)
    duals = barrier.Duals(np.ones(4), *(10**decades * each for each in push[1:]))
    moved = slacks - there
    step = barrier.slack_step(both, there, duals, moved, MU, CLOSE)
    after = barrier.update_multipliers(both, there, duals, step, share, MU)
    np.testing.assert_allclose(after.values, 1 + share * step.duals.values)
    for side in ("lower", "upper"):
        old, natural = getattr(duals, side), getattr(push, side)
        free = old + step.dual_share * getattr(step.duals, side)
        expected = np.clip(free, 1e-10 * natural, 1e10 * natural)
        np.testing.assert_allclose(getattr(after, side), expected, rtol=1e-9)


def test_where_all_conditions_hold_the_error_is_none_and_every_one_counts():
    both, slacks = bounds(), np.array([0.5, 1.0, 2.0, 3.0])
    none = Duals(np.zeros(4), np.zeros(4), np.zeros(4))
    assert barrier.optimality_error(both, np.zeros(2), slacks, slacks, none) == 0
    assert barrier.optimality_error(
        both, np.array([0.0, -0.3]), slacks, slacks, none
    ) == pytest.approx(0.3)
    apart = slacks + np.array([0.0, 0.2, 0.0, 0.0])
    assert barrier.optimality_error(both, np.zeros(2), apart, slacks, none) == pytest.approx(0.2)
    lower = Duals(np.array([-0.1, 0, 0, 0]), np.array([0.1, 0, 0, 0]), np.zeros(4))
    # The multiplier belongs to the slack; it is 1.5 from its bound.
    assert barrier.optimality_error(both, np.zeros(2), slacks, slacks, lower) == pytest.approx(0.15)
    alone = lower._replace(values=np.zeros(4), lower=np.zeros(4), upper=np.array([0, 0, 0, 0.4]))
    assert barrier.optimality_error(both, np.zeros(2), slacks, slacks, alone) == pytest.approx(0.4)
    assert barrier.optimality_error(both, np.array([np.nan, 0.0]), slacks, slacks, none) == np.inf
    unknown = none._replace(values=np.array([np.nan, 0, 0, 0]))
    assert barrier.optimality_error(both, np.zeros(2), slacks, slacks, unknown) == np.inf
    assert barrier.optimality_error(both, np.zeros(2), unknown.values, slacks, none) == np.inf
