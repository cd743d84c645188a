"""The robots that ship, and machines with what they have not."""

from functools import cache

import numpy as np

from constraints import Limit
from expdesign.configuration import load_run
from expdesign.configuration.limits import row_labels
from expdesign.configuration.robot import load_robot_description
from expdesign.motion.planning import STRUT_JERK
from expdesign.robot import LimitModel, load_robot, robot_from

SHIPPED = ("dehaeze", "linuxcnc", "mathworks", "palida", "rubin")
GENERAL, THREADED, STICKY = "general platform", "on threads", "sticking joints"
ALL = (*SHIPPED, GENERAL, THREADED)


@cache
def robot(name):
    """Return a robot that ships, or one of those that are made of PaLiDA."""
    if name in SHIPPED:
        return load_robot(name)
    mapping = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    rng = np.random.default_rng(12)
    if name == GENERAL:
        more = {"sx": 0.21, "sy": -0.13, "Ixy": 0.011, "Ixz": -0.023, "Iyz": 0.017}
        mapping |= {"platform": "general", "parameters": mapping["parameters"] | more}
    elif name == STICKY:
        mapping["parameters"] |= {"r_alpha": 25.0, "r_beta": 2.5}
        mapping["limits"]["actuator_force"] = 2000.0
    else:
        axes = np.array([[1.0, 0.0, 0.0]] * 6) + 0.2 * rng.normal(size=(6, 3))
        more = {f"{letter}{j}": value for letter, value in _MORE.items() for j in range(1, 7)}
        mapping |= {
            "terms": [
                *("struts", "rigid_platform", "drive_inertia", "force_offset"),
                {"cable": {"rest_length": 0.6}},
                *({"cogging": {"pitch": 0.024}}, "cogging_second"),
                {"gravity_compensation": _COMPENSATION},
                {"payload": {"x": 0.05, "y": -0.02, "z": 0.11}},
                *("platform_wrench", {"platform_spring": {"z": -0.6}}, "platform_drag"),
                "passive_viscous_friction",
                *("passive_friction", "actuator_friction"),
                *("asymmetric_friction", "quadratic_friction", "cubic_friction"),
                {"stribeck": {"velocity": 0.05}},
                *("load_friction", {"position_friction": {"length": 0.6}}),
                {"force_saturation": {"force": 150}},
            ],
            "drive": {"screw": {"lead": 0.02, "inertia": 2e-5}},
            "platform_cardan_axes": axes.tolist(),
            "parameters": mapping["parameters"] | more | _ONCE,
        }
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


_MORE = {
    "o": 4.0,
    "k": 35.0,
    "s": 6.0,
    "mu": 0.04,
    "cs": 3.0,
    "cc": -2.0,
    "ds": 0.7,
    "dc": 1.1,
    "a": 4.0,
    "w": -3.0,
    "c": 5.0,
    "rl": 2.0,
    "vl": -8.0,
    "sat": 0.03,
}
_ONCE = {
    "b_force": 60.0,
    "b_stiffness": -40.0,
    "m_payload": 1.5,
    "v_base": 0.07,
    "v_platform": 0.04,
}
_ONCE |= {"f_x": 3.0, "f_z": -2.0, "m_y": 0.4, "k_y": 25.0, "k_psi": 1.5, "d_x": 0.6, "d_phi": 0.1}
_COMPENSATION = {
    "base_x": 0.1,
    "base_y": -0.05,
    "base_z": -1.3,
    "platform_z": 0.04,
    "length": 0.7,
}


@cache
def everything(name):
    """Return the model of all that can be limited of a robot, and of the struts' jerk."""
    boundless = LimitModel.boundless(robot(name))
    jerk = Limit.boundless(STRUT_JERK, row_labels(STRUT_JERK))
    return LimitModel(boundless.robot, (*boundless.limits, jerk))
