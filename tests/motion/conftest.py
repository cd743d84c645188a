"""Motions that the tests share: designed ones would take minutes, random ones at limits do not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.experiment.setup import plan_search
from expdesign.motion.planning import executable_motion
from expdesign.recheck.certificate import recheck
from expdesign.solver.feasibility import GRID_MARGIN, random_start, shrink_to_limits
from expdesign.trajectory import FourierTrajectory

STEP = 1e-3
PERIODS = 3


@cache
def _configuration(robot, harmonics):
    return load_run(
        {
            "name": "motion",
            "robot": robot,
            "trajectory": {
                "harmonics": harmonics,
                "frequency": [0.1, 0.6],
                "samples": 100,
                "controller_period": STEP,
            },
            "experiment": {"periods": PERIODS},
        }
    )


@cache
def _orbit(robot, harmonics):
    """A random periodic motion that is scaled until it touches a limit."""
    problem = plan_search(_configuration(robot, harmonics)).problem
    x = random_start(problem, np.random.default_rng(harmonics), 200, 0.1)
    drawn = problem.variables.trajectory(x)
    omega = 2 * np.pi / (round(drawn.period / STEP) * STEP)
    motion = FourierTrajectory.from_displacements(
        omega, drawn.lambda0, 1.1 * drawn.sine, 1.1 * drawn.cosine
    )
    margin = GRID_MARGIN
    for _ in range(4):
        shrunk = shrink_to_limits(problem, motion, margin)
        check = recheck(problem.limits, shrunk.trajectory)
        if check.passed:
            break
        margin += 2 * check.worst
    assert shrunk.factor < 1
    assert check.passed
    assert check.worst > -5e-3
    return shrunk.trajectory


@cache
def _motion(robot, harmonics):
    return executable_motion(_configuration(robot, harmonics), _orbit(robot, harmonics))


@pytest.fixture(scope="session")
def configuration():
    """Return a maker of runs by robot and harmonics."""
    return _configuration


@pytest.fixture(scope="session")
def orbit():
    """Return a maker of periodic motions at their limits."""
    return _orbit


@pytest.fixture(scope="session")
def motion():
    """Return a maker of executable motions, each made once."""
    return _motion


@pytest.fixture(scope="session")
def with_motion():
    """Return a maker of a run with other settings of `motion`."""

    def made(configuration, **settings):
        section = configuration.run.motion.model_copy(update=settings)
        return replace(configuration, run=configuration.run.model_copy(update={"motion": section}))

    return made
