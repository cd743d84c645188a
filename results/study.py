"""Everything that is shown of a Monte-Carlo study."""

from __future__ import annotations

from pathlib import Path

from results.figures.montecarlo.catalogue import STUDY_FIGURES
from results.figures.saving import save_figures
from results.study_record import StudyRecord


def study_figures(folder: Path) -> tuple[Path, ...]:
    """Draw the figures of a study into ``figures/`` of its run folder.

    Parameters
    ----------
    folder : Path
        A run folder with `tables/montecarlo.csv`. Nothing else is read.

    Returns
    -------
    tuple of Path
        Each figure as PNG and SVG. The same folder gives the same bytes.

    Raises
    ------
    RunFolderError
        The table is missing (`MissingFileError`) or does not hold what it should.
    """
    return save_figures(STUDY_FIGURES, StudyRecord.load(Path(folder)), Path(folder) / "figures")
