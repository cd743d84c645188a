"""Arrays in structs and groups: HDF5, MATLAB and NumPy files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from estimation.data.formats import FileFormat
from estimation.data.table import (
    NUMERIC,
    FileContent,
    RawTable,
    RecordedColumn,
    pick_columns,
    refuse_long,
)
from expdesign.configuration import DataSection

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PLACES = (0, 512)
"""Positions of the signature: at the start, or after the user block of MATLAB."""

_UNIT_ATTRIBUTES = ("units", "unit")
_MOST_COLUMNS = 256
_NUMPY = ".npz"


def _is_hdf5(path: Path) -> bool:
    """Return whether a file has the signature of HDF5."""
    with path.open("rb") as file:
        for place in _PLACES:
            file.seek(place)
            if file.read(len(_SIGNATURE)) == _SIGNATURE:
                return True
    return False


def read_arrays(path: Path, section: DataSection) -> RawTable:
    """Read variables of MATLAB or NumPy; fields of structs have names such as ``recording.q1``.

    A Simulink "structure with time" has its signals under their labels too.
    """
    columns, arrays = _arrays(path)
    return _table(path, section, columns, arrays.__getitem__)


def _arrays(path: Path) -> tuple[list[RecordedColumn], dict[str, NDArray[Any]]]:
    """Return the columns of a file of MATLAB or NumPy, and their arrays by name."""
    columns: list[RecordedColumn] = []
    arrays: dict[str, NDArray[Any]] = {}
    if path.suffix.lower() == _NUMPY:
        with path.open("rb") as stream, np.load(stream) as archive:
            variables = dict(archive)
    else:
        variables = loadmat(path, simplify_cells=True)
    for variable, value in variables.items():
        if not variable.startswith("__"):
            for name, short, array in _numeric(value, variable, variable):
                arrays[name] = array
                columns += _array_columns(name, short, array.shape, name)
    return columns, arrays


def list_arrays(path: Path) -> FileContent:
    """List the columns of a file of MATLAB or NumPy."""
    return FileContent(_arrays(path)[0])


def read_hdf5(path: Path, section: DataSection, separator: str = "/") -> RawTable:
    """Read datasets, also members of compound ones; a name in a group is ``group/q1``.

    In MATLAB's files the groups are structs, and their fields have names such as ``recording.q1``.
    """
    with import_module("h5py").File(path, "r") as file:

        def load(place: tuple[str, str | None]) -> NDArray[Any]:
            name, member = place
            array = file[name][()]
            return np.asarray(array if member is None else array[member])

        return _table(path, section, _hdf5_columns(file, separator), load)


def list_hdf5(path: Path, separator: str = "/") -> FileContent:
    """List the columns of an HDF5 file."""
    with import_module("h5py").File(path, "r") as file:
        return FileContent(_hdf5_columns(file, separator))


def _hdf5_columns(file: Any, separator: str) -> list[RecordedColumn]:
    columns: list[RecordedColumn] = []

    def visit(name: str, item: Any) -> None:
        # MATLAB's own folders begin with #; links out of the file are not visited.
        if hasattr(item, "dtype") and not name.startswith("#"):
            columns.extend(_dataset_columns(item, separator))

    file.visititems(visit)
    return columns


def _dataset_columns(dataset: Any, separator: str) -> Iterator[RecordedColumn]:
    path = dataset.name.strip("/")
    name, short = path.replace("/", separator), path.rpartition("/")[2]
    if dataset.dtype.names is not None:
        for member in dataset.dtype.names:
            if dataset.dtype[member].kind in NUMERIC:
                shape = dataset.shape + dataset.dtype[member].shape
                full = f"{name}{separator}{member}"
                yield from _array_columns(full, member, shape, (path, member))
    elif dataset.dtype.kind in NUMERIC and dataset.attrs.get("MATLAB_class") != b"char":
        yield from _array_columns(name, short, dataset.shape, (path, None), _unit(dataset))


def _unit(dataset: Any) -> str | None:
    for attribute in _UNIT_ATTRIBUTES:
        unit = dataset.attrs.get(attribute)
        text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
        if isinstance(text, str) and text.strip():
            return text.strip()
    return None


def _numeric(value: Any, name: str, short: str) -> Iterator[tuple[str, str, NDArray[Any]]]:
    """Yield the arrays in a variable: name with and without its structs, and numbers."""
    if isinstance(value, dict):
        label = value.get("label")
        for key, item in value.items():
            labelled = key == "values" and isinstance(label, str) and label != ""
            yield from _numeric(item, f"{name}.{key}", str(label) if labelled else key)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for position, item in enumerate(np.ravel(np.asarray(value, dtype=object)), 1):
            yield from _numeric(item, f"{name}({position})", f"{short}({position})")
    elif isinstance(value, np.ndarray) and value.dtype.kind in NUMERIC:
        yield name, short, value


def _array_columns(
    name: str, short: str, shape: tuple[int, ...], place: Any, unit: str | None = None
) -> Iterator[RecordedColumn]:
    """Yield the columns of an array: a vector is one, a matrix ``m`` has ``m(:,1)``, ``m(:,2)`` ….

    Axes of length one do not count; the longer axis of a matrix is time. Scalars and arrays of
    more axes have no columns.
    """
    long = [size for size in shape if size != 1]
    if len(long) == 1:
        yield RecordedColumn(name, (place, None, long[0]), short=short, unit=unit)
    elif len(long) == 2 and min(long) <= _MOST_COLUMNS:  # noqa: PLR2004 - a matrix
        for k in range(min(long)):
            end = f"(:,{k + 1})"
            yield RecordedColumn(
                f"{name}{end}", (place, k, max(long)), short=f"{short}{end}", unit=unit
            )


def _table(
    path: Path,
    section: DataSection,
    columns: Sequence[RecordedColumn],
    load: Callable[[Any], NDArray[Any]],
) -> RawTable:
    """Pick the columns of the channels, and load each of their arrays once.

    Arrays that are too long are refused before: they may be few bytes in compressed form.
    `load` returns the array at a place of `_array_columns`.
    """
    picked = pick_columns(columns, section.columns, path, channels=section.channels)
    for column in picked.values():
        refuse_long(column.place[-1], path)
    loaded: dict[Any, NDArray[Any]] = {}
    values = {}
    for channel, column in picked.items():
        place, k, _ = column.place
        if place not in loaded:
            array = np.squeeze(load(place))
            loaded[place] = array.T if array.ndim > 1 and array.shape[1] > array.shape[0] else array
        array = loaded[place] if k is None else loaded[place][:, k]
        # Nanoseconds since 1970 are exact as integers only.
        exact = channel == "t" and array.dtype.kind in "iu"
        values[channel] = np.ascontiguousarray(array, dtype=None if exact else np.float64)
    return RawTable(path, values, picked)


def _is_not_hdf5(path: Path) -> bool:
    return not _is_hdf5(path)


FORMATS = (
    FileFormat(
        "HDF5",
        (".h5", ".hdf5", ".hdf"),
        read_hdf5,
        "h5py",
        "hdf5",
        may_crash=True,
        list_columns=list_hdf5,
    ),
    FileFormat(
        "MATLAB v7.3",
        (".mat",),
        partial(read_hdf5, separator="."),
        "h5py",
        "mat73",
        may_crash=True,
        accepts=_is_hdf5,
        list_columns=partial(list_hdf5, separator="."),
    ),
    FileFormat(
        "MATLAB up to v7",
        (".mat",),
        read_arrays,
        may_crash=True,
        accepts=_is_not_hdf5,
        list_columns=list_arrays,
    ),
    FileFormat("NumPy", (_NUMPY,), read_arrays, list_columns=list_arrays),
)
