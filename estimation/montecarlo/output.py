"""The files of a study in its run folder. Values are SI; the same study gives the same bytes."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimation.montecarlo.study import Study
from estimation.montecarlo.tables import STATISTICS, repetition_columns
from expdesign.configuration import resolved_yaml
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import add_columns

RECORD_FILE = "montecarlo.json"
STATISTICS_FILE = "tables/montecarlo.csv"
REPETITIONS_FILE = "tables/montecarlo_repetitions.csv"


def write_study(study: Study, folder: Path) -> list[Path]:
    """Write `montecarlo.json`, the tables, `columns.json` and `run.yaml`.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / REPETITIONS_FILE, repetitions_table(study))
    write_csv(folder / STATISTICS_FILE, statistics_table(study))
    write_json(folder / RECORD_FILE, study_record(study))
    write_text(folder / "run.yaml", resolved_yaml(study.configuration))
    columns = add_columns(
        folder,
        {STATISTICS_FILE: STATISTICS, REPETITIONS_FILE: repetition_columns(study.knowledge.names)},
    )
    names = (REPETITIONS_FILE, STATISTICS_FILE, RECORD_FILE, "run.yaml")
    return [*(folder / name for name in names), columns]


def statistics_table(study: Study) -> pd.DataFrame:
    """Return one row per estimator and estimated parameter."""
    truth, bound = study.truth.parameter_vector, study.bound_std
    place = {name: k for k, name in enumerate(study.knowledge.names)}
    identified = {study.knowledge.names[k] for k in study.identified}
    rows = [
        {
            "estimator": estimator,
            "parameter": name,
            "unit": parameter_unit(name),
            "truth": truth[place[name]],
            "identified": name in identified,
            "estimates": len(study.estimated(estimator)),
            "bound": bound[place[name]],
            **asdict(found),
        }
        for estimator in study.estimators
        for name, found in study.statistics(estimator).items()
    ]
    return pd.DataFrame(rows, columns=[column.name for column in STATISTICS])


def repetitions_table(study: Study) -> pd.DataFrame:
    """Return one row per repetition and estimator, those that failed included."""
    names = study.knowledge.names
    blank = np.full(len(names), np.nan)
    rows = []
    for repetition in study.repetitions:
        for estimator in study.estimators:
            outcome = repetition.outcomes[estimator]
            values = blank if outcome.values is None else outcome.values
            std = blank if outcome.std is None else outcome.std
            rows.append(
                [
                    repetition.number,
                    estimator,
                    outcome.error,
                    outcome.converged,
                    outcome.iterations,
                    repetition.harmonics,
                    repetition.freedom,
                    *values,
                    *std,
                ]
            )
    table = pd.DataFrame(rows, columns=[column.name for column in repetition_columns(names)])
    return table.astype({"harmonics": "Int64"})


def study_record(study: Study) -> dict[str, Any]:
    """Return what `montecarlo.json` states."""
    names = study.knowledge.names
    run, section = study.configuration.run, study.truth.experiment
    return {
        "units": "SI and radians",
        "name": run.name,
        "robot": study.robot.name,
        "repetitions": {"wanted": study.wanted, "done": len(study.repetitions)},
        "interrupted": study.interrupted,
        "estimators": {name: _estimator(study, name) for name in study.estimators},
        "parameters": [names[k] for k in study.free],
        "identified": [names[k] for k in study.identified],
        "truth": dict(study.truth.parameters),
        "bound_covariance": study.bound,
        "harmonics": _counts([r.harmonics for r in study.repetitions]),
        "settings": {
            "seed": run.montecarlo.seed,
            "experiment": section.model_dump(mode="json"),
            "samples": study.truth.samples,
            "samples_per_period": study.truth.samples_per_period,
            "estimate": run.estimate.model_dump(mode="json", exclude={"estimators"}),
        },
    }


def _estimator(study: Study, estimator: str) -> dict[str, Any]:
    outcomes = [outcome for _, outcome in study.estimated(estimator)]
    pooled = study.pooled(estimator)
    return {
        "estimates": len(outcomes),
        "not_converged": [r.number for r, o in study.estimated(estimator) if not o.converged],
        "failures": [
            {"repetition": number, "reason": reason} for number, reason in study.failures(estimator)
        ],
        "iterations": _counts([outcome.iterations for outcome in outcomes]),
        "pooled": None if pooled is None else asdict(pooled),
    }


def _counts(values: list[int | None]) -> dict[str, int]:
    """Return how often each number occurs, in ascending order."""
    counted = Counter(value for value in values if value is not None)
    return {str(value): counted[value] for value in sorted(counted)}
