"""What a format is that describes a machine: files of other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.robotfile.machine import Machine, Points

_DECIMALS = 12


@dataclass(frozen=True)
class MachineFormat:
    """A format of files, declared in :mod:`expdesign.robotfile.readers`."""

    title: str
    """For messages and the documentation."""
    extensions: tuple[str, ...]
    """Lower case, with the dot."""
    claims: Callable[[Path], bool]
    """``claims(path)`` tells, of a file that exists and has one of the extensions, whether it is of
    this format. What cannot be read is claimed by no format that shares its extension."""
    read: Callable[[str, tuple[Path, ...]], Machine]
    """``read(name, files)``: the machine, under the name that its robot is to have. An
    `InputError` says what is wrong with the files."""
    most_files: int = 1
    """That describe one machine together."""


def rows(points: Array) -> Points:
    """Return points (n, 3), m, as a machine has them; what units leave below 1e-12 m is rounded."""
    return tuple(tuple(float(v) + 0.0 for v in row) for row in np.round(points, _DECIMALS))
