"""The figures of an estimate, and of noise by itself, in a run folder."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from estimation.diagnostics import Diagnosis, NoiseAnalysis
from estimation.identification import EstimationResult
from results.figures.estimation.catalogue import (
    DIAGNOSTIC_FIGURES,
    ESTIMATE_FIGURES,
    NOISE_FIGURES,
)
from results.figures.saving import FORMATS, save_figures


def estimate_figures(
    result: EstimationResult, diagnosis: Diagnosis | None, folder: Path
) -> tuple[Path, ...]:
    """Draw the figures of an estimate into ``figures/`` of its run folder.

    Parameters
    ----------
    diagnosis : Diagnosis or None
        Of the best estimator; without it only the parameters are shown.

    Returns
    -------
    tuple of Path
        Each figure in the formats of `report.figures`; those of the diagnostics are numbered when
        there are several recordings.
    """
    place, formats = folder / "figures", result.configuration.run.report.figures
    paths = save_figures(ESTIMATE_FIGURES, result, place, formats=formats)
    if diagnosis is None:
        return paths
    several = len(diagnosis.experiments) > 1
    for number, experiment in enumerate(diagnosis.experiments, start=1):
        figures = DIAGNOSTIC_FIGURES
        if several:
            figures = tuple(replace(f, key=f"{f.key}_{number}") for f in figures)
        paths += save_figures(figures, experiment, place, formats=formats)
    return paths


def noise_figures(
    analysis: NoiseAnalysis, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of a noise analysis into ``figures/``; return the files."""
    return save_figures(NOISE_FIGURES, analysis, folder / "figures", formats=formats)
