"""A Stewart platform's variables in a MATLAB file.

Two sets of names are known: ``pos_base`` with ``pos_top`` or ``body_pts``, and ``height``, of the
MathWorks Stewart platform demonstration; and the struct ``stewart`` of stewart-simscape, with
``platform_F.Fa``, ``platform_M.Mb`` and ``geometry.H``. Any other file is read as a list of joints.

SciPy's reader trusts the sizes that a file declares: it runs in a separate process, which hands
over numbers as text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.errors import InputError
from expdesign.machines.machine import MachineDraft, MachineFormat, Question, rows
from expdesign.machines.readers.joint_list import draft_of_points
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.workers.local import EndlessError, run_isolated

_LARGEST = 64 * 1024 * 1024
_MOST_NUMBERS = 64
_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512

_NAMES = (
    "pos_base with pos_top or body_pts (and height), or the struct stewart with platform_F.Fa, "
    "platform_M.Mb and geometry.H"
)
_UNITS = Question(
    "base_joints", "A MATLAB file has no units: its lengths are taken as metres. Are they?"
)

_PROGRAM = f"""
import json
import numpy as np
from scipy.io import loadmat
found = {{}}
def collect(name, value, depth):
    if isinstance(value, dict) and depth < 4:
        for key, item in value.items():
            collect(name + "." + str(key) if name else str(key), item, depth + 1)
    elif not name.startswith("__"):
        array = np.asarray(value)
        if array.dtype.kind in "fiu" and 0 < array.size <= {_MOST_NUMBERS}:
            found[name] = array.astype(float).tolist()
collect("", loadmat(sys.argv[1], simplify_cells=True), 0)
print(json.dumps(found))
"""


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    values = {key: np.array(value, dtype=float) for key, value in _variables(files[0]).items()}
    source = f"MATLAB, {files[0].name}"
    if "pos_base" in values:
        height = "height" if "height" in values else ""
        platform = "body_pts" if "body_pts" in values and height else _ABOVE
        return _by_variables(name, source, values, files[0], ("pos_base", platform, height))
    if "stewart.platform_F.Fa" in values:
        return _by_variables(name, source, values, files[0], _STRUCT)
    return _by_names(name, source, values, files[0])


def _by_names(name: str, source: str, values: dict[str, Array], file: Path) -> MachineDraft:
    """Return the machine of two matrices by their names, or of an older struct.

    The older struct of stewart-simscape has the joints of the platform twice: Ab in the frame of
    Aa, and Bb in that of the platform.
    """
    last = {key.rpartition(".")[2]: value for key, value in values.items()}
    if {"Aa", "Ab", "Bb"} <= set(last):
        height = float(np.mean(_points(last, "Ab", file) - _points(last, "Bb", file), axis=0)[2])
        values = {"Aa": last["Aa"], "Bb": last["Bb"], "height": np.array(height)}
    return draft_of_points(name, source, _plain(values), file)


def _plain(values: Mapping[str, Array]) -> dict[str, Any]:
    return {k: float(v.reshape(())) if v.size == 1 else v for k, v in values.items()}


def _values(file: Path) -> dict[str, Any]:
    return _plain({key: np.array(one, dtype=float) for key, one in _variables(file).items()})


_ABOVE = "pos_top"
"""Joints of the platform over those of the base."""
_STRUCT = ("stewart.platform_F.Fa", "stewart.platform_M.Mb", "stewart.geometry.H")


def _by_variables(
    name: str, source: str, values: dict[str, Array], file: Path, keys: tuple[str, str, str]
) -> MachineDraft:
    """Return the machine of the variables for base, platform and height; no height: empty."""
    base, platform = (_points(values, key, file) for key in keys[:2])
    home, questions = platform.mean(axis=0), [_UNITS]
    if keys[2]:
        home = np.array([0.0, 0.0, _number(values, keys[2], file)])
    else:
        text = "The file has no height: the TCP is put into the middle of the upper joints."
        questions.append(Question("home", text))
    mass = _number(values, "top_mass", file) if "top_mass" in values else 0.0
    return MachineDraft(
        name=name,
        source=source,
        base_joints=rows(base),
        platform_joints=rows(platform - home if keys[1] == _ABOVE else platform),
        home=(*home.tolist(), 0.0, 0.0, 0.0),
        moved_mass=mass if mass > 0 else None,
        questions=tuple(questions),
    )


def _points(values: dict[str, Array], key: str, file: Path) -> Array:
    """Return six points of a matrix that has them in rows or in columns, (6, 3)."""
    value = _finite(values, key, file)
    if value.shape == (3, ACTUATORS):
        return value.T
    if value.shape != (ACTUATORS, 3):
        shape = " × ".join(str(size) for size in value.shape) or "one number"
        raise InputError(f"this is {shape}", file, key=key, allowed="6 × 3 or 3 × 6")
    return value


def _number(values: dict[str, Array], key: str, file: Path) -> float:
    value = _finite(values, key, file)
    if value.size != 1:
        raise InputError(f"these are {value.size} numbers", file, key=key, allowed="one number")
    return float(value.item())


def _finite(values: dict[str, Array], key: str, file: Path) -> Array:
    if key not in values:
        raise InputError("the variable is missing", file, key=key, allowed=_NAMES)
    if not np.all(np.isfinite(values[key])):
        raise InputError("not all of it are finite numbers", file, key=key)
    return values[key]


def _variables(path: Path) -> dict[str, Any]:
    """Return the small arrays of numbers in a file, fields of structs as ``stewart.geometry.H``."""
    with path.open("rb") as stream:
        start = stream.read(_USER_BLOCK + len(_HDF5))
    if _HDF5 in (start[: len(_HDF5)], start[_USER_BLOCK:]):
        raise InputError("this is MATLAB's format 7.3", path, allowed="save(…, '-v7')")
    if path.stat().st_size > _LARGEST:
        most = f"{_LARGEST // 1024**2} MiB; save only the variables of the geometry"
        raise InputError("the file is too large", path, allowed=most)
    try:
        found = run_isolated(_PROGRAM, path)
    except EndlessError:
        raise InputError("reading does not end: the file is damaged", path) from None
    if found is None:
        message = "the file is damaged, or not MATLAB's"
        raise InputError(message, path, allowed="a MATLAB file up to version 7")
    variables: dict[str, Any] = json.loads(found)
    return variables


FORMAT = MachineFormat("a MATLAB file", (".mat",), _read, points=_values)
