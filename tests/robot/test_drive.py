"""The inertia of drives in the forces, and the screw's thread in the lengths."""

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import load_robot, robot_from

SCREW = {"screw": {"lead": "5 mm", "inertia": 6.3e-5}}


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(palida, **changes):
    return robot_from(load_run({"name": "n", "robot": {**palida, **changes}}).robot)


def _motion(robot, times, seed=0):
    """Return pose, rate and acceleration of a smooth motion about home, (N, 6) each."""
    rng = np.random.default_rng(seed)
    size = np.repeat([0.04, 0.15], 3) * rng.uniform(0.5, 1, 6)
    speed, phase = rng.uniform(2, 5, 6), rng.uniform(0, 6, 6)
    angle = np.outer(times, speed) + phase
    return (
        robot.home + size * np.sin(angle),
        size * speed * np.cos(angle),
        -size * speed**2 * np.sin(angle),
    )


def _derivatives(function, times, step=2e-4):
    """Return first and second derivative of a function of time, by differences of fourth order."""
    f = [function(times + k * step) for k in (-2, -1, 0, 1, 2)]
    first = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * step)
    second = (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * step**2)
    return first, second


def test_a_drive_resists_the_acceleration_of_its_strut(palida):
    direct, screw = load_robot("palida"), _robot(palida, drive=SCREW)
    times = np.linspace(0, 2, 50)
    states = _motion(direct, times)
    _, second = _derivatives(lambda t: direct.inverse_kinematics(_motion(direct, t)[0]), times)
    mass = 6.3e-5 * (2 * np.pi / 5e-3) ** 2
    more = screw.actuator_forces(*states) - direct.actuator_forces(*states)
    np.testing.assert_allclose(more, mass * second, atol=1e-4 * np.abs(mass * second).max())
