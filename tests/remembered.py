"""Results of functions without side effects, for tests that are about other things."""

import hashlib
import io
import pickle
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FunctionType

import pytest

from estimation.identification import recording
from expdesign.export import certification
from expdesign.motion import planning, ramp_search
from expdesign.recheck import certificate, excitable, reach

_MADE = {}
_CLASSES = set()


@contextmanager
def remembered_proofs():
    """Prove the same limits of the same motion of the same robot once in this process."""
    with _remembered(certificate.certify, certificate, certification, planning, ramp_search):
        yield


@contextmanager
def remembered_checks():
    """Check the same robot and the channels of the same recording once in this process.

    Of the robot, that is its reach and its base parameters.
    """
    with (
        _remembered(reach.reach, excitable),
        _remembered(excitable.excitable, excitable),
        _remembered(recording.check_channels, recording),
    ):
        yield


@contextmanager
def _remembered(function, *modules):
    """Call a function once for the same arguments, in modules that import it."""

    def call(*arguments, **settings):
        key = function, _whole(arguments), _whole(sorted(settings.items()))
        if key not in _MADE:
            _MADE[key] = function(*arguments, **settings)
        return _MADE[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in modules:
            patch.setattr(module, function.__name__, call)
        yield


def _whole(value):
    """Return a digest of all that a value consists of."""
    stream = io.BytesIO()
    pickler = _ByContent(stream)
    pickler.fast = True  # equal parts are the same as one part that is used twice
    pickler.dump(value)
    return hashlib.sha256(stream.getvalue()).digest()


class _ByContent(pickle.Pickler):
    """Pickles dataclasses as their fields, without what they have cached, functions as code.

    Paths are left out: they are in messages only, and those of tests differ.
    """

    def reducer_override(self, value):
        if isinstance(value, Path):
            return Path, ()
        if isinstance(value, type):
            _CLASSES.add(value)  # a later one has another number
            return id, (id(value),)
        if isinstance(value, FunctionType):
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            own = value.__module__, value.__qualname__, hash(value.__code__)
            return tuple, (*own, value.__defaults__, value.__kwdefaults__, cells)
        if is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in fields(value))
        return NotImplemented
