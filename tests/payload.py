"""A term that says nothing new: a payload, a point mass at a known place of the platform."""

from contextlib import contextmanager

import casadi as ca
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.catalogue import TERMS
from expdesign.mechanism.term import Columns, Constant, Parameter, Scale, Term
from expdesign.robot import robot_from

MASS = "m_payload"
PLACE = {"x": 0.03, "y": -0.02, "z": 0.05}
"""m, in the platform frame."""


def _columns(instant):
    arm = instant.kinematic["rotation_matrix"] @ ca.vertcat(
        *(instant.constants[axis] for axis in PLACE)
    )
    omega = instant.angular_velocity
    acceleration = (
        instant.acceleration
        + ca.cross(instant.angular_acceleration, arm)
        + ca.cross(omega, ca.cross(omega, arm))
    )
    force = acceleration - instant.gravity
    return Columns(wrench=ca.vertcat(force, ca.cross(arm, force)))


TERM = Term(
    name="payload",
    meaning="a point mass at a known place of the platform",
    parameters=(Parameter(MASS, "kg", "mass", Scale("p10", mass=1), default=0.0),),
    columns=_columns,
    constants=tuple(Constant(axis, "m", f"its {axis}") for axis in PLACE),
)

REGROUPED = {
    "p10": 1.0,
    "sx": PLACE["x"],
    "sy": PLACE["y"],
    "p9": PLACE["z"],
    "p6": PLACE["y"] ** 2 + PLACE["z"] ** 2,
    "p7": PLACE["x"] ** 2 + PLACE["z"] ** 2,
    "p8": PLACE["x"] ** 2 + PLACE["y"] ** 2,
    "Ixy": -PLACE["x"] * PLACE["y"],
    "Ixz": -PLACE["x"] * PLACE["z"],
    "Iyz": -PLACE["y"] * PLACE["z"],
}
"""What a kilogram of it makes of mass, first moments and inertia of the platform, about the TCP."""


@contextmanager
def known_payload():
    """Let robot files name the term."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(TERMS, TERM.name, TERM)
        yield


def with_payload(name="palida", **values):
    """Return a robot that ships, with a general platform and the payload."""
    robot = described(name, {"payload": PLACE}, **values)
    robot["platform"] = "general"
    return robot_from(load_run({"name": "n", "robot": robot}).robot)


def described(name, *terms, **values):
    """Return what the file of a robot that ships says, with further terms and parameters."""
    found = load_robot_description(name).description.model_dump(mode="json", by_alias=True)
    found["terms"] = [*found["terms"], *terms]
    found["parameters"] = found["parameters"] | values
    return found
