"""MATLAB files up to version 7: variables, matrices, structs, structures with time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from estimation.data.columns import pick
from estimation.data.hierarchy import NUMERIC, Leaf, leaf_columns, load_columns
from estimation.data.readers.hdf5 import is_hdf5
from estimation.data.table import FileFormat, RawTable
from expdesign.configuration import DataSection


def read(path: Path, section: DataSection) -> RawTable:
    """Read variables; fields of structs have names such as ``recording.q1``.

    A Simulink "structure with time" has its signals under their labels too.
    """
    variables = loadmat(path, simplify_cells=True)
    arrays: dict[str, Any] = {}
    leaves = []
    for name, value in variables.items():
        if not name.startswith("__"):
            for leaf, array in _leaves(value, name, name):
                arrays[leaf.name] = array
                leaves.append(leaf)
    columns = [column for leaf in leaves for column in leaf_columns(leaf)]
    picked = pick(columns, section.columns, path)
    return RawTable(path, load_columns(picked, lambda name: arrays[name]), picked)


def _leaves(value: Any, name: str, short: str) -> Iterator[tuple[Leaf, Any]]:
    """Yield the numeric arrays in a variable, with the names of the structs they are in."""
    if isinstance(value, dict):
        label = value.get("label")
        for key, item in value.items():
            labelled = key == "values" and isinstance(label, str) and label != ""
            yield from _leaves(item, f"{name}.{key}", str(label) if labelled else key)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for position, item in enumerate(np.ravel(np.asarray(value, dtype=object)), 1):
            yield from _leaves(item, f"{name}({position})", f"{short}({position})")
    elif isinstance(value, np.ndarray) and value.dtype.kind in NUMERIC:
        yield Leaf(name, short, value.shape, name), value


def _accepts(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".mat" and not is_hdf5(path)


FORMATS = (
    FileFormat(
        title="MATLAB up to v7", extensions=(".mat",), read=read, may_crash=True, accepts=_accepts
    ),
)
