"""`report:`, what the report of a run contains."""

from __future__ import annotations

from typing import Annotated, Literal

from expdesign.configuration.base import Section
from expdesign.configuration.scalars import Distinct, Text, at_least, one_of

FigureFormat = Literal["png", "svg", "pdf"]


class ReportSection(Section):
    """Settings of the report.

    Attributes
    ----------
    title : str or None
        Heading; default: the run's name.
    figures : tuple of {"png", "svg", "pdf"}
        File formats of the figures.
    """

    title: Text | None = None
    figures: Annotated[
        tuple[Annotated[FigureFormat, one_of(FigureFormat)], ...], at_least(1, "formats"), Distinct
    ] = ("png", "svg")
