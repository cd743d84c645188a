"""The figures of an executable motion."""

from __future__ import annotations

from results.executed import MotionRecord
from results.figures.definition import FigureDefinition
from results.figures.motion import struts

MOTION_FIGURES: tuple[FigureDefinition[MotionRecord], ...] = (struts.FIGURE,)
