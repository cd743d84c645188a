"""Limits that bound a quantity as it is: data, without mathematics of their own."""

import math
from dataclasses import replace

import numpy as np

from constraints.definition import LimitDefinition, plain_limit

_BETA = plain_limit("beta", "cardan angle β", "rad", "interval")

LIMITS = (
    plain_limit("actuator_force", "actuator force", "N", "symmetric"),
    plain_limit("alpha", "cardan angle α", "rad", "interval"),
    replace(
        _BETA,
        requires=("beta", "sin_beta"),
        smooth=lambda quantities: quantities["sin_beta"],
        transform=np.sin,
    ),
    LimitDefinition(
        key="position",
        title="TCP position",
        unit="m",
        kind="interval",
        components=("x", "y", "z"),
        requires=("position",),
        natural=lambda quantities: quantities["position"],
    ),
    LimitDefinition(
        key="rotation",
        title="rotation angle",
        unit="rad",
        kind="interval",
        components=("phi", "theta", "psi"),
        requires=("rotation_angles",),
        natural=lambda quantities: quantities["rotation_angles"],
        about_home=math.radians(30),
    ),
    plain_limit("strut_acceleration", "strut acceleration", "m/s^2", "symmetric"),
    plain_limit("strut_length", "strut length", "m", "interval"),
    plain_limit("strut_speed", "strut speed", "m/s", "symmetric"),
)
