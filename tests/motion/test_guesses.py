"""Where the search for a ramp starts."""

import numpy as np
import pytest

from constraints import Limit
from expdesign.configuration.limits import row_labels
from expdesign.motion.executable import moving_states
from expdesign.motion.planning import STRUT_JERK
from expdesign.motion.ramp import MotionState, RampProblem
from expdesign.motion.ramp_search import pause_near, polynomials
from expdesign.robot import LimitModel
from tests.estimation.cases import ROBOT

WIDTH = 1e-3
JERK = Limit(STRUT_JERK, np.full(6, -5e3), np.full(6, 5e3), row_labels(STRUT_JERK), "")
LIMITS = LimitModel.of(ROBOT, JERK)


def _problem(*, arriving):
    rest = MotionState.at_rest(ROBOT.home)
    pose = ROBOT.home + np.array([2e-2, -1e-2, 1e-2, 0.02, 0.01, -0.03])
    orbit = MotionState(pose, np.full(6, 0.05), np.array([0.5, -0.2, 0.1, 0.3, 0.0, -0.4]))
    ends = (rest, orbit) if arriving else (orbit, rest)
    return RampProblem(LIMITS, *ends, 12, np.full(6, 0.1), 1.0)


@pytest.mark.parametrize("arriving", [True, False])
def test_the_pause_is_at_rest_near_the_orbit(arriving):
    problem = _problem(arriving=arriving)
    near = pause_near(problem, WIDTH, arriving=arriving)
    pause, orbit = (near.start, near.end) if arriving else (near.end, near.start)
    kept = problem.end if arriving else problem.start
    assert orbit is kept
    assert not np.any(pause.rate)
    assert not np.any(pause.acceleration)
    # The best of the polynomials from there keeps every limit.
    best = polynomials(near, WIDTH)[0]
    states = moving_states(best, np.linspace(0, best.duration, 50))
    assert np.max(LIMITS.violations(states)) < 0
    np.testing.assert_allclose(states[-1 if arriving else 0, :6], kept.pose, atol=1e-9)


def test_guesses_that_keep_the_limits_come_first_the_shortest_before_others():
    found = polynomials(_problem(arriving=True), WIDTH)
    durations = [ramp.duration for ramp in found]
    assert len(set(durations)) == len(durations)

    def worst(ramp):
        states = moving_states(ramp, np.linspace(0, 1, 200) * ramp.duration)
        return max(float(np.max(LIMITS.smooth_violations(states, WIDTH))), 0.0)

    excess = [worst(ramp) for ramp in found]
    kept = [duration for duration, one in zip(durations, excess, strict=True) if one == 0]
    assert kept == sorted(kept)
    assert durations[: len(kept)] == kept
