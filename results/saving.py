"""The figures of every record, written into its run folder."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from estimation.diagnostics.noise_result import NoiseRecord
from estimation.feedforward.result import FeedforwardResult
from estimation.identification.record import EstimateRecord
from estimation.montecarlo.result import MonteCarloResult
from estimation.validation.validate import ValidationRecord
from expdesign.experiment import DesignResult
from expdesign.experiment.sweep import SweepResult
from expdesign.export.result import ExportResult
from expdesign.robot import Robot
from results.figures.design import DESIGN_FIGURES
from results.figures.drawing import FORMATS, FigureDefinition, save_figures
from results.figures.feedforward import feedforward_figure
from results.figures.machine import machine_figure
from results.figures.montecarlo import STUDY_FIGURES
from results.figures.motion import WholeMotion, motion_figure
from results.figures.noise import NOISE_FIGURES, SPECTRUM_FIGURES
from results.figures.parameters import ESTIMATE_FIGURES, selection_figure
from results.figures.residuals import DIAGNOSTIC_FIGURES, prediction_figure
from results.figures.sweep import sweep_figure

Drawn = (
    DesignResult
    | SweepResult
    | NoiseRecord
    | EstimateRecord
    | ValidationRecord
    | FeedforwardResult
    | MonteCarloResult
)

_NOTES = {
    "interrupted": "interrupted: the best found until then",
    "limits broken": "this design breaks a limit",
}
"""What the figures of a design say that did not come to a good end, by its status."""

_ONLY: dict[type[Any], FigureDefinition[Any]] = {
    SweepResult: sweep_figure,
    FeedforwardResult: feedforward_figure,
}
"""Records with one figure."""


def record_figures(
    record: Drawn, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of a stage's record into ``figures/`` of its run folder; return the files.

    Those of the diagnostics are numbered when there are several recordings; without diagnostics
    only the parameters of an estimate are shown. Those of a design that was interrupted or breaks
    a limit say so. The same record gives the same bytes.
    """
    note = _NOTES.get(record.status, "") if isinstance(record, DesignResult) else ""
    if isinstance(record, SweepResult) and record.interrupted:
        note = "interrupted: designs are missing or not complete"
    return tuple(
        path
        for figures, drawn in _parts(record)
        for path in save_figures(figures, drawn, folder / "figures", note, formats)
    )


def design_figures(
    record: DesignResult, folder: Path, formats: Collection[str] | None = None
) -> tuple[Path, ...]:
    """Draw the figures of a design into ``figures/`` of its run folder; return the files.

    The record is ``result`` or ``DesignResult.read(folder)``; the formats, of
    "png", "svg" and "pdf", are those that `report.figures` of its run names by default.
    """
    wanted = record.configuration.run.report.figures if formats is None else formats
    return record_figures(record, folder, wanted)


def machine_drawing(
    robot: Robot, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw a robot at home into ``figures/`` of a run folder; return the files."""
    return save_figures((machine_figure,), robot, folder / "figures", formats=formats)


def whole_motion_figure(
    record: DesignResult, exports: ExportResult, folder: Path, formats: Collection[str]
) -> tuple[Path, ...]:
    """Draw the motion of the controller tables, from rest to rest, into ``figures/``.

    Return the files: none where its ramps are not recorded or the tables are not of this design.
    """
    ways = exports.motion.ways
    if ways is None:
        return ()
    try:
        motion = ways.motion(record.trajectory, record.robot.home)
    except ValueError:
        return ()
    whole = WholeMotion.of(record.configuration, motion)
    return save_figures((motion_figure,), whole, folder / "figures", formats=formats)


def _parts(record: Drawn) -> Iterator[tuple[Iterable[FigureDefinition[Any]], Any]]:
    """Yield the figures of a record, each lot with what it is drawn from."""
    match record:
        case DesignResult():
            yield DESIGN_FIGURES, record
        case SweepResult() | FeedforwardResult():
            yield [_ONLY[type(record)]], record
        case NoiseRecord():
            yield NOISE_FIGURES, record
            yield SPECTRUM_FIGURES, record
        case EstimateRecord():
            yield ESTIMATE_FIGURES, record
            yield [selection_figure] if record.selection else [], record
            for number, experiment in enumerate(record.experiments, start=1):
                ending = f"_{number}" if len(record.experiments) > 1 else ""
                own = (*DIAGNOSTIC_FIGURES, *NOISE_FIGURES)
                yield [figure.ending(ending) for figure in own], experiment
        case ValidationRecord():
            for number, motion in enumerate(record.motions, start=1):
                yield [prediction_figure.ending(f"_{number}")], motion
        case MonteCarloResult():
            yield STUDY_FIGURES, record.rows
