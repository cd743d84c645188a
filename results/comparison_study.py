"""The figures of a comparison on the digital twin, in its run folder."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from estimation.studies import DesignStudy, Study, ValidationStudy
from estimation.studies.validation_runs import SITUATIONS
from estimation.validation.record import MotionRecord
from results.figures.drawing import FORMATS, save_figures
from results.figures.estimation.residuals import PREDICTION_FIGURE
from results.figures.studies.catalogue import RECORD_FIGURES, REPETITIONS_FIGURE


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
        predictions = [
            (f"{motion}: {SITUATIONS[situation]}", diagnosis)
            for situation, motions in study.first.items()
            for motion, (_, diagnosis) in zip(study.motions, motions, strict=True)
        ]
        for number, (name, diagnosis) in enumerate(predictions, start=1):
            figure = replace(PREDICTION_FIGURE, key=f"{PREDICTION_FIGURE.key}_study_{number}")
            paths += save_figures(
                (figure,), MotionRecord.of(name, diagnosis), place, formats=formats
            )
    return paths
