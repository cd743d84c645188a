"""Run folders: one type for every file, complete or absent, and the manifest of its stages."""

from expdesign.runfolder.described import (
    MAY_BE_EMPTY,
    Column,
    Numbers,
    OpenNumber,
    OpenNumbers,
    copied,
    described,
    strutwise,
)
from expdesign.runfolder.folder_record import Contents, FolderRecord
from expdesign.runfolder.json_file import JsonFile, MissingFileError, RunFile
from expdesign.runfolder.table import ArrayTable, MatrixTable, RowTable, Table, describe_tables

__all__ = [
    "MAY_BE_EMPTY",
    "ArrayTable",
    "Column",
    "Contents",
    "FolderRecord",
    "JsonFile",
    "MatrixTable",
    "MissingFileError",
    "Numbers",
    "OpenNumber",
    "OpenNumbers",
    "RowTable",
    "RunFile",
    "Table",
    "copied",
    "describe_tables",
    "described",
    "strutwise",
]
