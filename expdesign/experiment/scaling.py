"""The scale of every parameter: what counts as one in criteria that depend on it."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.robot import Robot


def parameter_scaling(robot: Robot, scaling: str) -> Array:
    """Return (m,) the scale of every parameter: 1 (``si``), or its size (``nominal``).

    A nominal value of zero has the physical scale p10·L (first moments) or p10·L² (products of
    inertia), L the characteristic length; where the mass is zero too, 1.
    """
    if scaling == "si":
        return np.ones(len(robot.parameter_names))
    length = robot.characteristic_length
    mass = abs(robot.description.parameters["p10"])
    physical = dict.fromkeys(("sx", "sy", "p4", "p5", "p9"), mass * length)
    scales = []
    for name, value in zip(robot.parameter_names, robot.parameters, strict=True):
        scale = abs(value)
        if scale == 0 and name.startswith(("I", "p6", "p7", "p8")):
            scale = mass * length**2
        elif scale == 0:
            scale = physical.get(name, 1.0)
        scales.append(scale or 1.0)
    return np.array(scales)
