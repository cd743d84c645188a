"""The figures of noise, estimates, validations and Monte-Carlo studies, in their run folder."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from estimation.diagnostics.noise_record import NoiseRecord
from estimation.identification.record import EstimateRecord
from estimation.montecarlo.record import MonteCarloRecord
from estimation.validation.record import ValidationRecord
from results.figures.drawing import FORMATS, save_figures
from results.figures.estimation.noise import NOISE_FIGURES
from results.figures.estimation.parameters import ESTIMATE_FIGURES
from results.figures.estimation.residuals import DIAGNOSTIC_FIGURES, PREDICTION_FIGURE
from results.figures.montecarlo import STUDY_FIGURES, study_series

PLACE = "figures"


def noise_figures(
    record: NoiseRecord, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of a noise analysis into ``figures/``; return the files."""
    return save_figures(NOISE_FIGURES, record.pictures, folder / PLACE, formats=formats)


def estimate_figures(
    record: EstimateRecord, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of an estimate into ``figures/``; return the files.

    Those of the diagnostics are numbered when there are several recordings. Without diagnostics
    only the parameters are shown.
    """
    place = folder / PLACE
    paths = save_figures(ESTIMATE_FIGURES, record, place, formats=formats)
    several = len(record.experiments) > 1
    for number, experiment in enumerate(record.experiments, start=1):
        ending = f"_{number}" if several else ""
        residuals = [replace(f, key=f.key + ending) for f in DIAGNOSTIC_FIGURES]
        noise = [replace(f, key=f.key + ending) for f in NOISE_FIGURES]
        paths += save_figures(residuals, experiment, place, formats=formats)
        paths += save_figures(noise, experiment.pictures, place, formats=formats)
    return paths


def validation_figures(
    record: ValidationRecord, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the prediction of every motion into ``figures/``; return the files."""
    paths: tuple[Path, ...] = ()
    for number, motion in enumerate(record.motions, start=1):
        figure = replace(PREDICTION_FIGURE, key=f"{PREDICTION_FIGURE.key}_{number}")
        paths += save_figures((figure,), motion, folder / PLACE, formats=formats)
    return paths


def study_figures(
    record: MonteCarloRecord, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of a study into ``figures/``; return the files."""
    series = study_series(record.rows)
    return save_figures(STUDY_FIGURES, series, folder / PLACE, formats=formats)
