"""The figures of a comparison on the digital twin, in its run folder."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from estimation.studies import DesignStudy, Study, ValidationStudy
from estimation.validation.record import MotionRecord
from results.figures.estimation.residuals import PREDICTION_FIGURE
from results.figures.saving import FORMATS, save_figures
from results.figures.studies.catalogue import RECORD_FIGURES, REPETITIONS_FIGURE

_SITUATIONS = {
    "without": "no cogging",
    "unknown": "cogging unknown to the model",
    "known": "cogging in the identification too",
}


def comparison_study_figures(
    study: Study, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw the figures of a study into ``figures/``; return the files."""
    place = folder / "figures"
    paths: tuple[Path, ...] = ()
    if isinstance(study, DesignStudy):
        paths = save_figures((REPETITIONS_FIGURE,), study, place, formats=formats)
    definitions = RECORD_FIGURES[study.section.kind]
    paths += save_figures(definitions, study.record, place, formats=formats)
    if isinstance(study, ValidationStudy):
        paths += _predictions(study, place, formats)
    return paths


def _predictions(study: ValidationStudy, place: Path, formats: Collection[str]) -> tuple[Path, ...]:
    paths: tuple[Path, ...] = ()
    number = 0
    for situation, motions in study.first.items():
        for motion, (_, diagnosis) in zip(study.motions, motions, strict=True):
            number += 1
            name = f"{motion}: {_SITUATIONS[situation]}"
            record = MotionRecord.of(name, diagnosis)
            figure = replace(PREDICTION_FIGURE, key=f"{PREDICTION_FIGURE.key}_study_{number}")
            paths += save_figures((figure,), record, place, formats=formats)
    return paths
