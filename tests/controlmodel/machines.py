"""Robots whose control models are tested."""

import numpy as np

from estimation.controlmodel.model import Origin
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.hexapod import actuator_names
from expdesign.mechanism.terms import term_definitions
from expdesign.robot import robot_from

ORIGIN = Origin(file="robot.yaml", sha256="0" * 64, made="", version="0")


def every_term():
    """Return PaLiDA with every term that there is, screws that the platform turns, and tilt."""
    rng = np.random.default_rng(3)
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    constants = {
        "stribeck": {"velocity": "50 mm/s"},
        "cable": {"rest_length": 0.6},
        "cogging": {"pitch": "30 mm"},
        "gravity_compensation": {"base_x": 0.02, "base_y": 0.01, "base_z": -0.9, "length": 0.4},
        "force_saturation": {"force": 150},
        "position_friction": {"length": "60 cm"},
        "platform_spring": {"x": 0.01, "z": -0.6},
        "payload": {"x": 0.03, "y": -0.02, "z": 0.04},
    }
    terms = [{name: constants[name]} if name in constants else name for name in term_definitions()]
    extra = {"sx": 0.05, "sy": -0.03, "Ixy": 0.01, "Ixz": -0.02, "Iyz": 0.015}
    extra |= {"f_x": 3.0, "m_y": 0.4, "k_y": 25.0, "k_psi": 1.5, "d_x": 0.6, "d_phi": 0.1}
    extra |= {"v_base": 0.07, "v_platform": 0.04}
    extra |= {"b_force": -20.0, "b_stiffness": 30.0, "m_payload": 0.7}
    sizes = {"o": 8.0, "s": 6.0, "mu": 0.04, "k": 40.0, "a": 2.0, "w": 3.0, "c": 1.0}
    sizes |= {"cs": 4.0, "cc": 3.0, "ds": 2.0, "dc": 1.0, "rl": 2.0, "vl": 8.0, "sat": 0.02}
    for letter, size in sizes.items():
        extra |= dict(zip(actuator_names(letter), size * rng.uniform(0.5, 1, 6), strict=True))
    axes = np.array(palida["alpha_axes"]) + 0.3 * rng.normal(size=(6, 3))
    palida |= {
        "name": "2nd-machine",
        "platform": "general",
        "gravity": [0.5, -0.3, -9.78],
        "terms": terms,
        "parameters": {**palida["parameters"], **extra},
        "drive": {"screw": {"lead": "5 mm", "inertia": 1e-6}},
        "platform_cardan_axes": axes.tolist(),
    }
    return robot_from(load_run({"name": "n", "robot": palida}).robot)
