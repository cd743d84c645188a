"""The files of a simulated experiment in its run folder. Values are SI and radians."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from estimation.data.measurement import Measurement
from estimation.twin.truth import Truth
from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import MEASUREMENT, add_columns
from expdesign.trajectory import FourierTrajectory

MEASUREMENT_FILE = "measurement.csv"
TRUTH_FILE = "truth.json"
REPETITIONS = "repetitions"


def repetition_file(repetition: int) -> str:
    """Return where in the run folder one of several repetitions stands."""
    return f"{REPETITIONS}/{repetition:04d}/{MEASUREMENT_FILE}"


def write_measurement(measurement: Measurement, path: Path) -> None:
    """Write a measurement with all digits: t, q1 … q6, Q1 … Q6 and, where known, the period."""
    table = pd.DataFrame({"t": measurement.time})
    for name, values in (("q", measurement.lengths), ("Q", measurement.forces)):
        for strut in range(6):
            table[f"{name}{strut + 1}"] = values[:, strut]
    if measurement.period is not None:
        table["period"] = measurement.period
    write_csv(path, table)


def write_truth(
    truth: Truth, configuration: RunConfiguration, folder: Path, *, repeated: bool
) -> list[Path]:
    """Write what stands beside the measurements: `truth.json`, `columns.json`, `run.yaml`.

    Parameters
    ----------
    truth : Truth
    configuration : RunConfiguration
    folder : Path
    repeated : bool
        Whether the measurements are in `repetitions/`.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    measured = f"{REPETITIONS}/*/{MEASUREMENT_FILE}" if repeated else MEASUREMENT_FILE
    write_json(folder / TRUTH_FILE, truth_record(truth))
    write_text(folder / "run.yaml", resolved_yaml(configuration))
    columns = add_columns(folder, {measured: MEASUREMENT})
    return [folder / TRUTH_FILE, folder / "run.yaml", columns]


def truth_record(truth: Truth) -> dict[str, Any]:
    """Return what `truth.json` states."""
    section = truth.experiment
    return {
        "units": "SI and radians",
        "name": truth.name,
        "robot": truth.robot,
        "parameters": dict(truth.parameters),
        "experiment": {
            "periods": section.periods,
            "sampling": section.sampling,
            "samples": truth.samples,
            "samples_per_period": truth.samples_per_period,
        },
        "design": _series(truth.design),
        "executed": _series(truth.executed),
        "force_covariance": truth.force_covariance,
        "length_covariance": truth.length_covariance,
        "table": None if truth.table is None else asdict(truth.table),
        "disturbances": {
            "tracking_error": _section(section.tracking_error),
            "drift": {"size": section.drift, "final": truth.final_drift} if section.drift else None,
            "cogging": _section(section.cogging),
            "quantisation": _section(section.quantisation),
            "outliers": _section(section.outliers),
        },
        "seeds": {"experiment": section.seed, "repetitions": truth.seed},
    }


def _series(trajectory: FourierTrajectory) -> dict[str, Any]:
    return {
        "harmonics": trajectory.harmonics,
        "omega": trajectory.omega,
        "frequency_hz": trajectory.frequency,
        "period": trajectory.period,
        "lambda0": trajectory.lambda0,
        "mu": trajectory.mu,
        "nu": trajectory.nu,
    }


def _section(section: Any) -> dict[str, Any] | None:
    return None if section is None else section.model_dump()
