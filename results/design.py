"""The figures of a design, and of the motion that executes it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from expdesign.experiment import DesignRecord
from expdesign.export.record import ExportsRecord
from results.executed import MotionRecord
from results.figures.design.catalogue import DESIGN_FIGURES
from results.figures.drawing import save_figures
from results.figures.struts import MOTION

_NOTES = {
    "interrupted": "interrupted: the best found until then",
    "limits broken": "this design breaks a limit",
}
"""What the figures of a design say that did not come to a good end, by its status."""


def design_figures(
    record: DesignRecord, folder: Path, formats: Collection[str] | None = None
) -> tuple[Path, ...]:
    """Draw the figures of a design into ``figures/`` of a run folder.

    Parameters
    ----------
    record : DesignRecord
        ``DesignRecord.of(result)``, or ``DesignRecord.read(folder)``.
    folder : Path
    formats : collection of {"png", "svg", "pdf"}, optional
        `report.figures` of the run by default.

    Returns
    -------
    tuple of Path
        Each figure in every format. The same record gives the same bytes. Those of a design that
        was interrupted or breaks a limit say so.
    """
    note = _NOTES.get(record.summary.status, "")
    wanted = record.configuration.run.report.figures if formats is None else formats
    return save_figures(DESIGN_FIGURES, record, folder / "figures", note, wanted)


def motion_figure(
    record: DesignRecord, exports: ExportsRecord, folder: Path, formats: Collection[str]
) -> tuple[Path, ...]:
    """Draw the motion of the controller tables, from rest to rest, into ``figures/``.

    Return the files: none where its ramps are not recorded or the tables are not of this design.
    """
    ways = exports.motion.ways
    if ways is None:
        return ()
    try:
        motion = ways.motion(record.summary.trajectory, record.robot.home)
    except ValueError:
        return ()
    executed = MotionRecord.of(record.configuration, motion)
    return save_figures((MOTION,), executed, folder / "figures", formats=formats)
