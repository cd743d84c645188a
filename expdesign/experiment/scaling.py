"""The scale of every parameter: what counts as one in criteria that depend on it."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.term import parameters_of
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot


def parameter_scaling(robot: Robot, scaling: str) -> Array:
    """Return (m,) the scale of every parameter: 1 (``si``), or its size (``nominal``).

    A nominal value of zero has the scale that its term states by mass, length and gravity of the
    robot; where that is zero too, 1.
    """
    if scaling == "si":
        return np.ones(len(robot.parameter_names))
    mass = abs(robot.description.parameters.get(MASS, 0.0))
    gravity = float(np.linalg.norm(robot.description.gravity))
    size = (mass, robot.characteristic_length, gravity)
    physical = [parameter.scale.of(*size) for parameter in parameters_of(robot.terms)]
    return np.where(robot.parameters == 0, physical, np.abs(robot.parameters))
