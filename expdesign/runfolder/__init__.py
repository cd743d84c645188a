"""Run folders: one type for every file, complete or absent, and the manifest of its stages."""

from expdesign.runfolder.described import (
    MAY_BE_EMPTY,
    Column,
    Covariance,
    Numbers,
    OpenNumber,
    OpenNumbers,
    WholeNumbers,
    copied,
    described,
    sized,
    strutwise,
)
from expdesign.runfolder.folder_record import Contents, FolderRecord, RowKeys
from expdesign.runfolder.json_file import JsonFile, MissingFileError, RunFile
from expdesign.runfolder.table import ArrayTable, MatrixTable, RowTable, Table, describe_tables

__all__ = [
    "MAY_BE_EMPTY",
    "ArrayTable",
    "Column",
    "Contents",
    "Covariance",
    "FolderRecord",
    "JsonFile",
    "MatrixTable",
    "MissingFileError",
    "Numbers",
    "OpenNumber",
    "OpenNumbers",
    "RowKeys",
    "RowTable",
    "RunFile",
    "Table",
    "WholeNumbers",
    "copied",
    "describe_tables",
    "described",
    "sized",
    "strutwise",
]
