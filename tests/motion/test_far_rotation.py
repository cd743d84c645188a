"""A ramp out of a pose that is turned by 1.28 rad, where dry friction binds again and again."""

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.motion import planning
from expdesign.motion import ramp_search as ramp_module
from expdesign.recheck.limit_check import TOLERANCE
from expdesign.trajectory import FourierTrajectory

# Near the limits of PaLiDA, ψ largest at t = 0. Rows: x, y, z, φ, θ, ψ; columns: harmonics.
TURNED = FourierTrajectory.from_displacements(
    2 * np.pi / 1.872,
    [0, 0, -0.604, 0, 0, 1.1892],
    [
        [-0.0064, -0.0027, 0.0028],
        [-0.0109, 0.0013, 0.002],
        [-0.0063, -0.0045, -0.0015],
        [0.0105, 0.0021, -0.0078],
        [-0.0045, 0.0057, -0.0017],
        [0.0267, 0.0469, 0.0122],
    ],
    [
        [-0.0029, -0.0042, -0.0014],
        [0.0003, 0.0052, 0.0025],
        [-0.0036, 0.0043, -0.0002],
        [0.013, -0.0131, -0.0088],
        [-0.0199, 0.0129, 0.004],
        [0.07, 0.0145, 0.0062],
    ],
)


@pytest.fixture(scope="module")
def plan():
    run = {"name": "turned", "robot": "palida", "experiment": {"periods": 1}}
    return planning._plan(load_run(run), TURNED)


@pytest.fixture(scope="module")
def ramp_out(plan):
    _, (name, problem) = plan.problems(0.0, planning.PIECES)
    return name, problem, plan.guesses(problem, 0.0)


@pytest.mark.slow
def test_the_first_guess_comes_to_a_ramp(monkeypatch, plan, ramp_out):
    """By steps of 2 % it came to none, and a guess of 0.167 s was taken."""
    monkeypatch.setattr(ramp_module, "_ATTEMPTS", 1)
    name, problem, guesses = ramp_out
    found = ramp_module.find_ramp(problem, guesses, name, plan.step, plan.width)
    assert found.duration < 0.16
    assert ramp_module.worst_limit(problem, found).violation <= TOLERANCE


def test_a_guess_is_taken_with_the_reserve(plan, ramp_out):
    name, problem, guesses = ramp_out
    found = ramp_module._plain_ramp(problem, guesses, name, plan.step)
    assert ramp_module.worst_limit(problem, found).violation <= -ramp_module.RESERVE
