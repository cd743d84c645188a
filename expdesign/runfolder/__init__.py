"""Run folders: one type for every file, complete or absent, and the manifest of its stages."""

from expdesign.runfolder.described import (
    MAY_BE_EMPTY,
    Column,
    Numbers,
    OpenNumber,
    OpenNumbers,
    array_columns,
    described,
)
from expdesign.runfolder.json_file import JsonFile, MissingFileError
from expdesign.runfolder.table import ArrayTable, MatrixTable, RowTable, Table, describe_tables

__all__ = [
    "MAY_BE_EMPTY",
    "ArrayTable",
    "Column",
    "JsonFile",
    "MatrixTable",
    "MissingFileError",
    "Numbers",
    "OpenNumber",
    "OpenNumbers",
    "RowTable",
    "Table",
    "array_columns",
    "describe_tables",
    "described",
]
