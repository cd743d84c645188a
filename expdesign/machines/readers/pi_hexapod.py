"""PI's description of a hexapod in YAML, as its ROS driver has one for the H-811.

Metres and radians. Base anchors are given in the frame of the zero pose, platform anchors in the
platform frame, and the orientation is R = Rx(u) Ry(v) Rz(w): the angles of the pose. Source:
PI_ROS_Driver, pi_hexapod_description and pi_hexapod_control.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, create_model, model_validator

from expdesign.configuration.document import read_yaml
from expdesign.configuration.errors import quote, refusal
from expdesign.configuration.schema import validate
from expdesign.machines.machine import MachineDraft, MachineFormat, Question, rows
from expdesign.mechanism.hexapod import ACTUATORS

_AXES = {
    "position": {"x": "x", "y": "y", "z": "z"},
    "rotation": {"u": "phi", "v": "theta", "w": "psi"},
}
"""Components of the pose by PI's name of an axis."""
_JOINTS = tuple(f"axis_{j}" for j in range(ACTUATORS))
_PER_AXIS = {
    "vel_max_xyz": ("limits.strut_speed", "m/s along the axes"),
    "vel_max_uvw": ("limits.strut_speed", "rad/s about the axes"),
    "effort_limit": ("limits.actuator_force", "for the axes of the platform"),
}


def _read_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise refusal(f"{quote(value)} is not a number", "a number, in metres and radians")
    return float(value)


_Number = Annotated[float, BeforeValidator(_read_number)]


class _Anchor(BaseModel):
    x: _Number
    y: _Number
    z: _Number


class _Strut(BaseModel):
    base_anchor: _Anchor
    platform_anchor: _Anchor


class _Range(BaseModel):
    lower_limit: _Number
    upper_limit: _Number

    @model_validator(mode="after")
    def _check_order(self) -> _Range:
        if self.lower_limit >= self.upper_limit:
            raise refusal("lower_limit is not below upper_limit", "a range")
        return self


_STRUTS: dict[str, Any] = dict.fromkeys(_JOINTS, (_Strut, ...))
_RANGES: dict[str, Any] = {axis: (_Range | None, None) for axes in _AXES.values() for axis in axes}
_Description = create_model("_Description", **_STRUTS, **_RANGES)


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    document = read_yaml(files[0])
    found = validate(_Description, document.data, document)
    struts = [getattr(found, axis) for axis in _JOINTS]
    base, platform = (
        np.array([list(vars(getattr(strut, end)).values()) for strut in struts])
        for end in ("base_anchor", "platform_anchor")
    )
    limits: dict[str, Any] = {}
    for key, axes in _AXES.items():
        stated = {component: getattr(found, axis) for axis, component in axes.items()}
        ranges = {c: (r.lower_limit, r.upper_limit) for c, r in stated.items() if r is not None}
        limits |= {key: ranges} if ranges else {}
    questions = [
        Question(
            "limits.strut_length",
            "PI's file limits the pose and not the struts: how short and how long can they be?",
        )
    ]
    for key, (place, words) in _PER_AXIS.items():
        value = document.data.get(key)
        if value is not None:
            text = f"PI's file has {key} = {quote(value)}, {words}: what can one strut do?"
            questions.append(Question(place, text))
    return MachineDraft(
        name=name,
        source=f"PI hexapod, {files[0].name}",
        base_joints=rows(base),
        platform_joints=rows(platform),
        home=(0.0,) * ACTUATORS,
        limits=limits,
        questions=tuple(questions),
    )


def _claims(path: Path) -> bool:
    data = read_yaml(path).data
    return any(
        isinstance(axis := data.get(name), dict)
        and ("base_anchor" in axis or "platform_anchor" in axis)
        for name in _JOINTS
    )


FORMAT = MachineFormat("PI's hexapod description", (".yaml", ".yml"), _read, _claims)
