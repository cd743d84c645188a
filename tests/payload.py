"""A term that says nothing new: a payload, a point mass at a known place of the platform."""

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import robot_from

MASS = "m_payload"
PLACE = {"x": 0.03, "y": -0.02, "z": 0.05}
"""m, in the platform frame."""


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
