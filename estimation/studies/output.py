"""`study.json` and the tables of a study in its run folder. Values are SI and radians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from estimation.studies.claim import Claim
from estimation.studies.design_output import design_claims, design_tables
from estimation.studies.design_study import DesignStudy, trial_name
from estimation.studies.identification_output import identification_claims, identification_tables
from estimation.studies.identification_study import IdentificationStudy
from estimation.studies.tables import TABLES
from estimation.studies.validation_output import validation_claims, validation_tables
from estimation.studies.validation_study import ValidationStudy
from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.experiment.output import write_design
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import add_columns

NAME = "study.json"
DESIGNS = "designs"

AnyStudy = DesignStudy | IdentificationStudy | ValidationStudy


def write_comparison(study: AnyStudy, folder: Path) -> list[Path]:
    """Write what a study came to; return the files.

    A study of designs leaves every design as a run folder of its own in ``designs/``.
    """
    # Everything is computed before anything is written: a folder is not left half made.
    tables, record = _tables(study), _record(study)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    if isinstance(study, DesignStudy):
        for trial in study.trials:
            place = folder / DESIGNS / trial_name(trial.number, trial.criterion)
            written += write_design(trial.design, place)
    for name, table in tables.items():
        path = folder / "tables" / f"{name}.csv"
        write_csv(path, table)
        written.append(path)
    written.append(add_columns(folder, {f"tables/{name}.csv": TABLES[name] for name in tables}))
    write_json(folder / NAME, record)
    write_text(folder / "run.yaml", resolved_yaml(study.configuration))
    return [*written, folder / NAME, folder / "run.yaml"]


def claims(study: AnyStudy) -> Sequence[Claim]:
    """Return what the study was to show."""
    if isinstance(study, DesignStudy):
        return design_claims(study)
    if isinstance(study, IdentificationStudy):
        return identification_claims(study)
    return validation_claims(study)


def _tables(study: AnyStudy) -> Mapping[str, pd.DataFrame]:
    if isinstance(study, DesignStudy):
        return design_tables(study)
    if isinstance(study, IdentificationStudy):
        return identification_tables(study)
    return validation_tables(study)


def _record(study: AnyStudy) -> dict[str, Any]:
    configuration: RunConfiguration = study.configuration
    section = configuration.run.study
    return {
        "units": "SI and radians",
        "name": configuration.run.name,
        "robot": study.robot.name,
        "simulated": True,
        "kind": "" if section is None else section.kind,
        "settings": None if section is None else section.model_dump(mode="json"),
        "seeds": {
            "design": configuration.run.design.seed,
            "experiment": configuration.run.experiment.seed,
            "montecarlo": configuration.run.montecarlo.seed,
        },
        "claims": [claim.as_dict() for claim in claims(study)],
    }
