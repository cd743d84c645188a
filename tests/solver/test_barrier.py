"""Slacks and their bounds."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from expdesign.solver.barrier import Bounds
from tests.solver.programs import INF

LOWER = np.array([-1.0, -INF, 0.0, -INF])
UPPER = np.array([1.0, 2.0, INF, INF])
CLOSE = 0.9


def bounds():
    empty = np.empty(0)
    return Bounds.of(SimpleNamespace(lower=empty, upper=empty, row_lower=LOWER, row_upper=UPPER))


VALUES = arrays(float, 4, elements=st.floats(-5, 5))
SLACKS = st.tuples(
    st.floats(-0.999, 0.999), st.floats(-5, 1.999), st.floats(0.001, 5), st.floats(-5, 5)
).map(np.array)


@given(VALUES, SLACKS, SLACKS)
def test_a_slack_follows_its_row_only_where_this_stays_away_from_its_bounds(values, slacks, before):
    both = bounds()
    gaps = both.gaps(before)
    found = both.following(values, slacks, gaps, CLOSE)
    for k in range(4):
        below = np.isinf(LOWER[k]) or values[k] - LOWER[k] >= (1 - CLOSE) * gaps[0][k]
        above = np.isinf(UPPER[k]) or UPPER[k] - values[k] >= (1 - CLOSE) * gaps[1][k]
        assert found[k] == (values[k] if below and above else slacks[k])
    assert np.all((found > LOWER) & (found < UPPER))


@given(SLACKS)
def test_rounding_never_leaves_a_slack_on_its_bound(slacks):
    both = bounds()
    on = np.where(np.isfinite(UPPER), UPPER, np.where(np.isfinite(LOWER), LOWER, slacks))
    found = both.off(on)
    assert np.all((found > LOWER) & (found < UPPER))
    assert all(np.all(gap > 0) for gap in both.gaps(found))
    np.testing.assert_array_equal(both.off(slacks), slacks)
