"""The figures of a validation, in its run folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from estimation.validation import ValidationResult
from results.figures.estimation import prediction
from results.figures.saving import save_figures


def validation_figures(result: ValidationResult, folder: Path) -> tuple[Path, ...]:
    """Draw the prediction of every motion into ``figures/``; return the files."""
    paths: tuple[Path, ...] = ()
    formats = result.configuration.run.report.figures
    for number, motion in enumerate(result.motions, start=1):
        figure = replace(prediction.FIGURE, key=f"{prediction.FIGURE.key}_{number}")
        paths += save_figures((figure,), motion, folder / "figures", formats=formats)
    return paths
