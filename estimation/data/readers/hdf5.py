"""HDF5 files."""

from __future__ import annotations

from pathlib import Path

from estimation.data.file_format import FileFormat
from estimation.data.hdf5_file import read_hdf5
from estimation.data.table import RawTable
from expdesign.configuration import DataSection


def read(path: Path, section: DataSection) -> RawTable:
    """Read datasets, also members of compound ones; a name in a group is ``group/q1``."""
    return read_hdf5(path, section, separator="/")


FORMAT = FileFormat(
    title="HDF5",
    extensions=(".h5", ".hdf5", ".hdf"),
    read=read,
    library="h5py",
    extra="hdf5",
    may_crash=True,
)
