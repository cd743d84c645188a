"""A Fourier trajectory in a JSON file: the keys that it is written with, wherever it stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import (
    Field,
    FiniteFloat,
    GetCoreSchemaHandler,
    Strict,
    ValidationInfo,
)
from pydantic_core import CoreSchema, core_schema

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.runfolder import JsonFile, described
from expdesign.trajectory.fourier import FourierTrajectory

_Number = Annotated[FiniteFloat, Strict()]


class _Lists:
    """An array that is lists of numbers in the file: one for each coordinate of the pose."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_after_validator_function(
            _array,
            handler.generate_schema(self.kind),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda array: array),
        )


def _array(values: list[Any], info: ValidationInfo) -> Array:
    """Return lists as an array; refuse too few or too many coordinates or harmonics."""
    if len(values) != COORDINATES:
        raise ValueError(f"there are {len(values)} entries where {COORDINATES} are needed")
    harmonics = info.data.get("harmonics")
    lengths = {len(value) for value in values if isinstance(value, list)}
    if harmonics is not None and lengths - {harmonics}:
        found = " and ".join(map(str, sorted(lengths - {harmonics})))
        raise ValueError(f"a list has {found} entries where the {harmonics} harmonics are needed")
    return np.array(values, dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class FourierKeys:
    """The keys of a trajectory: a file that holds one, or a part of it, has these."""

    harmonics: Annotated[
        int, Field(ge=1, strict=True), described("1", "number n of harmonics, at least 1")
    ]
    omega: Annotated[_Number, Field(gt=0), described("rad/s", "base frequency")]
    lambda0: Annotated[
        Array, _Lists(list[_Number]), described("m, rad", "centre of the motion, six numbers")
    ]
    mu: Annotated[
        Array,
        _Lists(list[list[_Number]]),
        described("m/s, rad/s", "rate amplitudes of cos kωt, six lists of n numbers"),
    ]
    nu: Annotated[
        Array,
        _Lists(list[list[_Number]]),
        described("m/s, rad/s", "rate amplitudes of sin kωt, six lists of n numbers"),
    ]

    @property
    def trajectory(self) -> FourierTrajectory:
        """The trajectory itself."""
        return FourierTrajectory(self.omega, self.lambda0, self.mu, self.nu)


def fourier_keys(trajectory: FourierTrajectory) -> dict[str, Any]:
    """Return the values of the keys, for the types that have further ones."""
    return {name: getattr(trajectory, name) for name in FourierKeys.__dataclass_fields__}


@dataclass(frozen=True, eq=False, kw_only=True)
class TrajectoryFile(FourierKeys, JsonFile):
    """What other stages need of a `design.json`, whoever wrote it."""

    FILE: ClassVar[str] = "design.json"
    WRITTEN_BY: ClassVar[str] = (
        "`expdesign design`, or by hand: JSON with harmonics, omega, lambda0, mu and nu"
    )
    robot: Annotated[str | None, described("", "name of the robot that it was designed for")] = None
    status: Annotated[str | None, described("", "how the design ended")] = None
