"""HDF5 files, those of MATLAB 7.3 among them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimation.data.columns import Column, pick
from estimation.data.hierarchy import NUMERIC, Leaf, leaf_columns, load_columns
from estimation.data.table import FileFormat, RawTable
from expdesign.configuration import DataSection

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PLACES = (0, 512)
"""Where the signature stands: at the start, or after the user block of MATLAB."""

_UNIT_ATTRIBUTES = ("units", "unit")


def is_hdf5(path: Path) -> bool:
    """Tell by its signature whether a file is HDF5."""
    with path.open("rb") as file:
        for place in _PLACES:
            file.seek(place)
            if file.read(len(_SIGNATURE)) == _SIGNATURE:
                return True
    return False


def read(path: Path, section: DataSection) -> RawTable:
    """Read datasets, also members of compound ones; a name in a group is ``group/q1``."""
    return _read(path, section, separator="/")


def read_matlab(path: Path, section: DataSection) -> RawTable:
    """Read MATLAB's variables; fields of structs have names such as ``recording.q1``."""
    return _read(path, section, separator=".")


def _read(path: Path, section: DataSection, separator: str) -> RawTable:
    h5py = import_module("h5py")
    with h5py.File(path, "r") as file:
        columns: list[Column] = []
        for dataset in _datasets(file, h5py):
            for leaf in _leaves(dataset, separator):
                columns.extend(leaf_columns(leaf))
        picked = pick(columns, section.columns, path)

        def load(place: tuple[str, str | None]) -> NDArray[Any]:
            name, member = place
            array = file[name][()]
            return np.asarray(array if member is None else array[member])

        return RawTable(path, load_columns(picked, load), picked)


def _datasets(file: Any, h5py: Any) -> list[Any]:
    """Return all datasets but MATLAB's own folders; links out of the file are not followed."""
    found: list[Any] = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            found.append(item)

    file.visititems(visit)
    return found


def _leaves(dataset: Any, separator: str) -> Iterator[Leaf]:
    path = dataset.name.strip("/")
    name, short = path.replace("/", separator), path.rpartition("/")[2]
    if dataset.dtype.names is not None:
        for member in dataset.dtype.names:
            if dataset.dtype[member].kind in NUMERIC:
                shape = dataset.shape + dataset.dtype[member].shape
                yield Leaf(f"{name}{separator}{member}", member, shape, (path, member))
    elif dataset.dtype.kind in NUMERIC and dataset.attrs.get("MATLAB_class") != b"char":
        yield Leaf(name, short, dataset.shape, (path, None), _unit(dataset))


def _unit(dataset: Any) -> str | None:
    for attribute in _UNIT_ATTRIBUTES:
        unit = dataset.attrs.get(attribute)
        text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
        if isinstance(text, str) and text.strip():
            return text.strip()
    return None


def _is_matlab(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".mat" and is_hdf5(path)


FORMATS = (
    FileFormat(
        title="HDF5",
        extensions=(".h5", ".hdf5", ".hdf"),
        read=read,
        library="h5py",
        extra="hdf5",
        may_crash=True,
    ),
    FileFormat(
        title="MATLAB v7.3",
        extensions=(".mat",),
        read=read_matlab,
        library="h5py",
        extra="mat73",
        may_crash=True,
        accepts=_is_matlab,
    ),
)
