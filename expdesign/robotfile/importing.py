"""From files of another program to what they say of a machine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from constraints.plugins import declarations
from expdesign.configuration.problem import InputError
from expdesign.robotfile import readers
from expdesign.robotfile.home_in_range import without_contradictions
from expdesign.robotfile.machine import Machine
from expdesign.robotfile.machine_format import MachineFormat

_FARTHEST = 1000.0
"""Of a joint or of home from their frame, m."""


@cache
def machine_formats() -> tuple[MachineFormat, ...]:
    """Return every format; a new one is one file in `expdesign.robotfile.readers`, or a plug-in."""
    return declarations(MachineFormat, readers, "FORMAT")


def read_machine(name: str, files: Sequence[Path]) -> Machine:
    """Return what files say of one machine, in SI units; what they do not say is a question.

    Parameters
    ----------
    name : str
        Of the robot that is to be written.
    files : sequence of Path
        All of one format; LinuxCNC's INI and HAL files belong together.

    Raises
    ------
    InputError
        A file is missing, of no known format, damaged, or describes no hexapod with struts whose
        lengths change.
    """
    if not files:
        raise InputError("no file is named", allowed="the files that describe the machine")
    found = [_format_of(path) for path in files]
    first = found[0]
    for path, each in zip(files, found, strict=True):
        if each is not first:
            message = f"this is {each.title}, {files[0]} is {first.title}"
            raise InputError(message, path, allowed="files of one format")
    if len(files) > first.most_files:
        message = f"one machine is described by at most {first.most_files} file of {first.title}"
        raise InputError(message, files[first.most_files])
    machine = without_contradictions(first.read(name, tuple(files)))
    for key in ("base_joints", "platform_joints", "home"):
        value = getattr(machine, key)
        farthest = float(np.max(np.abs(value))) if isinstance(value, tuple) else 0.0
        if farthest > _FARTHEST:
            message = f"{farthest:.3g} m away: a length is damaged, or in another unit"
            raise InputError(message, files[0], key=key, allowed=f"{_FARTHEST:g} m at most")
    return machine


def _format_of(path: Path) -> MachineFormat:
    if not path.exists():
        raise InputError("there is no such file", path)
    if path.is_dir():
        raise InputError("this is a folder, not a file", path)
    suffix = path.suffix.lower()
    candidates = [each for each in machine_formats() if suffix in each.extensions]
    for each in candidates:
        if each.claims(path):
            return each
    if candidates:
        titles = " or ".join(each.title for each in candidates)
        raise InputError("the file's content is not known", path, allowed=titles)
    known = ", ".join(f"{each.title} ({', '.join(each.extensions)})" for each in machine_formats())
    raise InputError(f"'{path.suffix}' is no known extension", path, allowed=known)
