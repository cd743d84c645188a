"""PaLiDA with cogging and a Stribeck hump, whose pitch and velocity are estimated."""

from functools import cache

import numpy as np

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import robot_from
from tests.estimation.cases import ROBOT, measured, trajectory

STEP = 0.01
MOTION = trajectory(100, STEP)
PITCH, VELOCITY = 0.03, 0.06
WAVES = {f"{name}{j}": value for name, value in (("cs", 9.0), ("cc", -5.0)) for j in range(1, 7)}
HUMPS = {f"s{j}": 15.0 for j in range(1, 7)}
QUIET = 0.1


@cache
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def terms(pitch, velocity):
    return [*DEFAULT, {"cogging": {"pitch": pitch}}, {"stribeck": {"velocity": velocity}}]


def guess(value):
    return {"value": value, "estimate": True}


def noise():
    own = ROBOT.description.noise
    sizes = {"force": own.force_covariance, "length": own.length_covariance}
    return {f"{kind}_covariance": (QUIET**2 * size).tolist() for kind, size in sizes.items()}


PITCH_BEGUN, VELOCITY_BEGUN = guess(1.02 * PITCH), guess(1.3 * VELOCITY)


def run(pitch=PITCH_BEGUN, velocity=VELOCITY_BEGUN, estimate=None, **sections):
    robot = palida() | {"terms": terms(pitch, velocity)}
    section = {"noise": "given", "harmonics": 2, "estimators": ["gm"], **(estimate or {})}
    given = {"noise": noise(), "estimate": section, **sections}
    return load_run({"name": "n", "robot": robot, **given})


@cache
def machine():
    parameters = palida()["parameters"] | WAVES | HUMPS
    robot = palida() | {"terms": terms(PITCH, VELOCITY), "parameters": parameters}
    return robot_from(load_run({"name": "n", "robot": robot}).robot)


def data(seed=0, scale=QUIET):
    return measured(MOTION, seed, robot=machine(), step=STEP, force_scale=scale, length_scale=scale)


def constants(found):
    """Return pitch and velocity of an estimate, and their standard deviations."""
    start = {"cogging_pitch": 1.02 * PITCH, "stribeck_velocity": 1.3 * VELOCITY}
    known = found.systematic
    names = [one.name for one in known.deviations]
    at = [names.index(name) for name in start]
    return np.array(list(start.values())) + known.values[at], known.std[at]
