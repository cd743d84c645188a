"""`export:`, the controller tables that are written."""

from __future__ import annotations

from typing import Annotated, Literal

from expdesign.schema.scalars import Distinct, at_least, one_of

ExportFormat = Literal[
    "csv",
    "ros2",
    "xps-pvt",
    "linuxcnc-gcode",
    "linuxcnc-strut",
    "pmac-pvt",
    "pi-wave",
    "pvt-csv",
    "mat",
]

ExportFormats = Annotated[
    tuple[Annotated[ExportFormat, one_of(ExportFormat)], ...], at_least(0, "formats"), Distinct
]
