"""Run folders: results stored from the annotations of their fields, and the manifest of stages."""

from expdesign.runfolder.fields import (
    JSON_ONLY,
    MAY_BE_EMPTY,
    Column,
    Covariance,
    Numbers,
    OpenNumber,
    OpenNumbers,
    UnboundedNumber,
    UnboundedNumbers,
    WholeNumbers,
    described,
    sized,
    strutwise,
)
from expdesign.runfolder.files import MissingFileError
from expdesign.runfolder.places import Matrix, Numbered, Place, StoredConfiguration, Table, Text
from expdesign.runfolder.store import (
    JsonFile,
    RunFile,
    StageResult,
)
from expdesign.runfolder.tables import ArrayTable, CsvFile, MatrixTable, RowTable, describe_tables

__all__ = [
    "JSON_ONLY",
    "MAY_BE_EMPTY",
    "ArrayTable",
    "Column",
    "Covariance",
    "CsvFile",
    "JsonFile",
    "Matrix",
    "MatrixTable",
    "MissingFileError",
    "Numbered",
    "Numbers",
    "OpenNumber",
    "OpenNumbers",
    "Place",
    "RowTable",
    "RunFile",
    "StageResult",
    "StoredConfiguration",
    "Table",
    "Text",
    "UnboundedNumber",
    "UnboundedNumbers",
    "WholeNumbers",
    "describe_tables",
    "described",
    "sized",
    "strutwise",
]
