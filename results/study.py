"""Everything that is shown of a Monte-Carlo study."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from results.figures.montecarlo.catalogue import STUDY_FIGURES
from results.figures.saving import FORMATS, save_figures
from results.study_record import StudyRecord


def study_figures(folder: Path, formats: Collection[str] = FORMATS) -> tuple[Path, ...]:
    """Draw the figures of a study into ``figures/`` of its run folder.

    Parameters
    ----------
    folder : Path
        A run folder with `tables/montecarlo.csv`. Nothing else is read.
    formats : collection of {"png", "svg", "pdf"}

    Returns
    -------
    tuple of Path
        Each figure in every format. The same folder gives the same bytes.

    Raises
    ------
    InputError
        The table is missing (`MissingFileError`) or does not hold what it should.
    """
    record = StudyRecord.load(Path(folder))
    return save_figures(STUDY_FIGURES, record, Path(folder) / "figures", formats=formats)
