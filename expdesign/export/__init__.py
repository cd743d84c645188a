"""Controller tables: a motion in the format of the controller that executes it."""

from expdesign.export.definition import Settings, TableError, TableFormat, Task
from expdesign.export.exporting import (
    Export,
    ExportError,
    export_table,
    file_name,
    refuse_missing_library,
    refuse_unreadable_name,
)
from expdesign.export.formats import table_formats
from expdesign.export.read_back import ReadBack, read_back
from expdesign.export.readme import readme
from expdesign.export.record import (
    FOLDER,
    RECORD,
    ExportsRecord,
    FileEntry,
    MotionEntry,
    record_of_one,
)
from expdesign.export.table_file import TableFile, find_table_file, read_table_file

__all__ = [
    "FOLDER",
    "RECORD",
    "Export",
    "ExportError",
    "ExportsRecord",
    "FileEntry",
    "MotionEntry",
    "ReadBack",
    "Settings",
    "TableError",
    "TableFile",
    "TableFormat",
    "Task",
    "export_table",
    "file_name",
    "find_table_file",
    "read_back",
    "read_table_file",
    "readme",
    "record_of_one",
    "refuse_missing_library",
    "refuse_unreadable_name",
    "table_formats",
]
