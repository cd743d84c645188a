"""The files of a validation in its run folder. Values are SI and radians."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimation.validation.validate import MotionValidation, ValidationResult
from expdesign.configuration import resolved_yaml
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import add_columns
from expdesign.runfolder.described import Column

VALIDATION = (
    Column("number", "1", "number of the motion"),
    Column("motion", "", "which motion"),
    Column("actuator", "1", "actuator"),
    Column("rms_measured", "N", "rms of the measured force about its mean"),
    Column("rms_residual", "N", "rms of measured minus predicted force, mean over the periods"),
    Column("variance_model_error", "N^2", "of single samples about the prediction"),
    Column("variance_measurement_error", "N^2", "of single samples about the mean over periods"),
    Column("statistic", "1", "F of the lack-of-fit test; empty where it was refused"),
    Column("p_value", "1", "of that test"),
    Column("verdict", "", "passes, fails or not tested"),
)
"""Columns of `tables/validation.csv`."""

_STRUTS = range(1, 7)

FORCES = (
    Column("t", "s", "time"),
    *(Column(f"Q{j}", "N", f"measured force of actuator {j}, mean over periods") for j in _STRUTS),
    *(Column(f"Q{j}_predicted", "N", f"predicted force of actuator {j}") for j in _STRUTS),
)
"""Columns of `tables/validation_forces_<number>.csv`."""


def write_validation(result: ValidationResult, folder: Path) -> list[Path]:
    """Write `validation.json` and the tables; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "tables" / "validation.csv"
    write_csv(table, validation_table(result))
    written = [table]
    described: dict[str, tuple[Column, ...]] = {"tables/validation.csv": VALIDATION}
    for number, motion in enumerate(result.motions, start=1):
        path = folder / "tables" / f"validation_forces_{number}.csv"
        write_csv(path, forces_table(result, motion))
        described[f"tables/{path.name}"] = FORCES
        written.append(path)
    written.append(add_columns(folder, described))
    record = folder / "validation.json"
    write_json(record, validation_record(result))
    write_text(folder / "run.yaml", resolved_yaml(result.configuration))
    return [*written, record]


def validation_table(result: ValidationResult) -> pd.DataFrame:
    """Return one row per motion and actuator."""
    rows = []
    for number, motion in enumerate(result.motions, start=1):
        diagnosis = motion.diagnosis.experiments[0]
        test, variances = diagnosis.lack_of_fit, diagnosis.variances
        forces, rest = motion.experiment.forces, diagnosis.residuals.forces
        for j in range(6):
            refused = bool(test.refused)
            fails = not refused and bool(test.failed[j])
            rows.append(
                {
                    "number": number,
                    "motion": motion.name,
                    "actuator": j + 1,
                    "rms_measured": float(np.std(forces[:, j])),
                    "rms_residual": float(np.sqrt(np.mean(rest[:, j] ** 2))),
                    "variance_model_error": float(variances.model_error[j]),
                    "variance_measurement_error": float(variances.measurement_error[j]),
                    "statistic": float(test.statistic[j]),
                    "p_value": float(test.p_values[j]),
                    "verdict": "not tested" if refused else "fails" if fails else "passes",
                }
            )
    return pd.DataFrame(rows, columns=[column.name for column in VALIDATION])


def forces_table(result: ValidationResult, motion: MotionValidation) -> pd.DataFrame:
    """Return measured and predicted forces of one motion."""
    experiment = motion.experiment
    predicted = experiment.regressors(result.robot) @ result.saved.estimate.values
    blocks = [experiment.times[:, None], experiment.forces, predicted]
    return pd.DataFrame(np.concatenate(blocks, axis=1), columns=[c.name for c in FORCES])


def validation_record(result: ValidationResult) -> dict[str, Any]:
    """Return what `validation.json` states."""
    return {
        "units": "SI and radians",
        "name": result.configuration.run.name,
        "robot": result.robot.name,
        "estimate": str(result.saved.path),
        "estimator": result.saved.estimate.estimator,
        "accepted": result.accepted,
        "motions": [
            {
                "name": motion.name,
                "simulated": motion.simulated,
                "period": motion.experiment.record.period,
                "periods": motion.experiment.record.periods,
                "diagnostics": motion.diagnosis.as_dict(),
            }
            for motion in result.motions
        ],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }
