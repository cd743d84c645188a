"""Everything that is shown of a design run."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from results.figures.design.catalogue import DESIGN_FIGURES
from results.figures.saving import save_figures
from results.record import DesignRecord

_NOTES = {
    "interrupted": "interrupted: the best found until then",
    "limits broken": "this design breaks a limit",
}
"""What the figures of a design say that did not come to a good end, by its status."""


def design_figures(folder: Path, formats: Collection[str] | None = None) -> tuple[Path, ...]:
    """Draw the figures of a design into ``figures/`` of its run folder.

    Parameters
    ----------
    folder : Path
        A run folder with `run.yaml`, `design.json`, `trajectory.csv` and the tables
        `convergence`, `limits`, `parameters` and `eigenvalues`. Nothing else is read.
    formats : collection of {"png", "svg", "pdf"}, optional
        `report.figures` of its `run.yaml` by default.

    Returns
    -------
    tuple of Path
        Each figure in every format. The same folder gives the same bytes. Those of a design that
        was interrupted or breaks a limit say so.

    Raises
    ------
    RunFolderError
        A file is missing (`MissingFileError`) or does not hold what it should.
    InputError
        `run.yaml` is not a valid run.
    """
    record = DesignRecord.load(Path(folder))
    note = _NOTES.get(record.summary.status, "")
    wanted = record.configuration.run.report.figures if formats is None else formats
    return save_figures(DESIGN_FIGURES, record, record.folder / "figures", note, wanted)
