"""MATLAB files of version 7.3, which are HDF5."""

from __future__ import annotations

from pathlib import Path

from estimation.data.file_format import FileFormat
from estimation.data.hdf5_file import is_hdf5, read_hdf5
from estimation.data.table import RawTable
from expdesign.configuration import DataSection


def read(path: Path, section: DataSection) -> RawTable:
    """Read variables; fields of structs have names such as ``recording.q1``."""
    return read_hdf5(path, section, separator=".")


def _accepts(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".mat" and is_hdf5(path)


FORMAT = FileFormat(
    title="MATLAB v7.3",
    extensions=(".mat",),
    read=read,
    library="h5py",
    extra="mat73",
    may_crash=True,
    accepts=_accepts,
)
