"""Controller tables: a motion in the format of the controller that executes it."""

from expdesign.export.table_file import find_table_file

__all__ = ["find_table_file"]
