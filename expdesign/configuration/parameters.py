"""The parameters of a hexapod: names, order, units (the project's model of a 6-UPS robot)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, SerializerFunctionWrapHandler, model_serializer

from expdesign.configuration.base import Section
from expdesign.configuration.quantity import (
    DAMPING,
    FIRST_MOMENT,
    FORCE,
    INERTIA,
    MASS,
    TORQUE,
    Damping,
    Dimension,
    FirstMoment,
    Force,
    Inertia,
    Mass,
    Torque,
)
from expdesign.configuration.scalars import known_key

_RIGID: dict[str, Dimension] = {
    **dict.fromkeys(("p1", "p2", "p3"), INERTIA),
    **dict.fromkeys(("p4", "p5"), FIRST_MOMENT),
    **dict.fromkeys(("p6", "p7", "p8"), INERTIA),
    "p9": FIRST_MOMENT,
    "p10": MASS,
}
_GENERAL: dict[str, Dimension] = {
    **dict.fromkeys(("sx", "sy"), FIRST_MOMENT),
    **dict.fromkeys(("Ixy", "Ixz", "Iyz"), INERTIA),
}
_FRICTION: dict[str, Dimension] = {
    **dict.fromkeys(("r_alpha", "r_beta"), TORQUE),
    **dict.fromkeys(("r1", "r2", "r3", "r4", "r5", "r6"), FORCE),
    **dict.fromkeys(("v1", "v2", "v3", "v4", "v5", "v6"), DAMPING),
}

GENERAL_ONLY = tuple(_GENERAL)
"""Parameters that only a platform without symmetry has."""

SYMMETRIC_PARAMETERS = (*_RIGID, *_FRICTION)
"""The 24 parameters of a hexapod with a symmetric platform, in their order."""

GENERAL_PARAMETERS = (*_RIGID, *_GENERAL, *_FRICTION)
"""The 29 parameters of a hexapod with a general platform, in their order."""

PARAMETER_DIMENSIONS: dict[str, Dimension] = {**_RIGID, **_GENERAL, **_FRICTION}

known_parameter = known_key(GENERAL_PARAMETERS, "parameter")
ParameterName = Annotated[str, BeforeValidator(known_parameter)]


class ParametersDescription(Section):
    """Nominal (a-priori) parameter values in SI units; they need not be physically consistent."""

    p1: Inertia
    p2: Inertia
    p3: Inertia
    p4: FirstMoment
    p5: FirstMoment
    p6: Inertia
    p7: Inertia
    p8: Inertia
    p9: FirstMoment
    p10: Mass
    sx: FirstMoment | None = None
    sy: FirstMoment | None = None
    Ixy: Inertia | None = None
    Ixz: Inertia | None = None
    Iyz: Inertia | None = None
    r_alpha: Torque
    r_beta: Torque
    r1: Force
    r2: Force
    r3: Force
    r4: Force
    r5: Force
    r6: Force
    v1: Damping
    v2: Damping
    v3: Damping
    v4: Damping
    v5: Damping
    v6: Damping

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in handler(self).items() if value is not None}
