"""Controller tables: a motion in the format of the controller that executes it."""

from expdesign.export.catalogue import table_formats
from expdesign.export.definition import Settings, TableFormat, Task
from expdesign.export.exporting import (
    Export,
    ExportError,
    export_table,
    file_name,
    refuse_missing_library,
)
from expdesign.export.read_back import ReadBack, read_back
from expdesign.export.readme import file_record, motion_record, readme
from expdesign.export.rows import TableError
from expdesign.export.table_file import TableFile, read_table_file

__all__ = [
    "Export",
    "ExportError",
    "ReadBack",
    "Settings",
    "TableError",
    "TableFile",
    "TableFormat",
    "Task",
    "export_table",
    "file_name",
    "file_record",
    "motion_record",
    "read_back",
    "read_table_file",
    "readme",
    "refuse_missing_library",
    "table_formats",
]
