"""Proofs of limits that are made once for tests that are about other things."""

import hashlib
from contextlib import contextmanager
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from pydantic import BaseModel

from constraints import Limit
from expdesign.configuration.robot import ResolvedRobot
from expdesign.export import certification
from expdesign.motion import planning, ramp_search
from expdesign.recheck import certificate

_MADE = {}


@contextmanager
def remembered_proofs():
    """Prove the same limits of the same motion of the same robot once in this process."""
    prove = certificate.certify

    def certify(limits, motion, **settings):
        key = hashlib.sha256(b"\0".join(_content((limits, motion, *settings.items())))).digest()
        if key not in _MADE:
            _MADE[key] = prove(limits, motion, **settings)
        return _MADE[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in (certificate, certification, planning, ramp_search):
            patch.setattr(module, "certify", certify)
        yield


def _content(value):
    """Yield all numbers and texts of limits and motions, without their initial values."""
    yield type(value).__name__.encode()
    if isinstance(value, np.ndarray):
        yield str(value.shape).encode() + value.tobytes()
    elif isinstance(value, BaseModel):
        yield value.model_dump_json().encode()
    elif isinstance(value, ResolvedRobot):
        # A payload and deviations are not in the description.
        joints = (value.base_joints, value.platform_joints, value.gravity)
        numbers = (value.constants, *value.parameters.items(), value.forces_of_voltages)
        yield from _content((value.description, joints, numbers))
    elif isinstance(value, Limit):
        yield from _content((value.key, value.lower, value.upper, value.labels, value.reserve))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _content(part)
    elif is_dataclass(value):
        for field in fields(value):
            if field.name != "guess":
                yield from _content(getattr(value, field.name))
    else:
        assert isinstance(value, str | int | float | None), type(value)
        yield repr(value).encode()
