"""The files of an estimation in its run folder. Values are SI and radians."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimation.estimators import ParameterEstimate
from estimation.identification.result import EstimationResult, RecordSummary
from estimation.identification.tables import ESTIMATES, MOTION, TABLES
from estimation.measurement_model import HarmonicMotion
from estimation.processing.noise import NoiseEstimate, NoiseModel
from estimation.uncertainty import correlation
from expdesign.configuration import resolved_yaml
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import add_columns
from expdesign.runfolder.described import Column


def write_estimate(
    result: EstimationResult, folder: Path, diagnosis: dict[str, Any] | None = None
) -> list[Path]:
    """Write `estimates.csv`, `estimate.json`, the tables and the estimated motions.

    Parameters
    ----------
    diagnosis : dict, optional
        What `estimation.diagnostics` found, by estimator.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "correlation": (correlation_table(result), None),
        "covariance": (covariance_table(result), None),
        "precision": (precision_table(result), TABLES["precision"]),
        "noise": (noise_table(result), TABLES["noise"]),
    }
    for number, record in enumerate(result.records, start=1):
        if record.experiment.fit is not None:
            suffix = f"_{number}" if len(result.records) > 1 else ""
            tables[f"estimated_motion{suffix}"] = (motion_table(result, number - 1), MOTION)
    written = []
    for name, (table, _) in tables.items():
        path = folder / "tables" / f"{name}.csv"
        write_csv(path, table)
        written.append(path)
    estimates = folder / "estimates.csv"
    write_csv(estimates, estimates_table(result))
    described: dict[str, tuple[Column, ...]] = {"estimates.csv": ESTIMATES}
    described |= {f"tables/{n}.csv": columns for n, (_, columns) in tables.items() if columns}
    written.append(add_columns(folder, described))
    record_file = folder / "estimate.json"
    write_json(record_file, estimate_record(result, diagnosis))
    write_text(folder / "run.yaml", resolved_yaml(result.configuration))
    return [*written, estimates, record_file]


def estimates_table(result: EstimationResult) -> pd.DataFrame:
    """Return one row per estimator and parameter."""
    return pd.DataFrame(
        [asdict(row) for row in result.rows], columns=[column.name for column in ESTIMATES]
    )


def correlation_table(result: EstimationResult) -> pd.DataFrame:
    """Return the correlation matrix of every estimator's parameters."""
    return _matrices(result, lambda estimate: correlation(estimate.covariance))


def covariance_table(result: EstimationResult) -> pd.DataFrame:
    """Return the covariance matrix of every estimator's parameters, SI."""
    return _matrices(result, lambda estimate: estimate.covariance)


def _matrices(result: EstimationResult, matrix: Any) -> pd.DataFrame:
    names = list(result.knowledge.names)
    parts = []
    for name, estimate in result.estimates.items():
        table = pd.DataFrame(matrix(estimate), columns=names)
        table.insert(0, "parameter", names)
        table.insert(0, "estimator", name)
        parts.append(table)
    return pd.concat(parts, ignore_index=True)


def precision_table(result: EstimationResult) -> pd.DataFrame:
    """Return the shares of every standard deviation beside the Cramér–Rao bound."""
    bound = None if result.bound is None else np.sqrt(np.diag(result.bound))
    rows = []
    for name, estimate in result.estimates.items():
        share = estimate.kinematic_share
        for k, parameter in enumerate(result.knowledge.names):
            kinematic = np.nan if share is None else np.sqrt(max(float(share[k, k]), 0.0))
            rows.append(
                {
                    "estimator": name,
                    "parameter": parameter,
                    "std": estimate.std[k],
                    "std_forces": np.sqrt(estimate.force_share[k, k]),
                    "std_kinematics": kinematic,
                    "bound": np.nan if bound is None else bound[k],
                }
            )
    return pd.DataFrame(rows)


def noise_table(result: EstimationResult) -> pd.DataFrame:
    """Return Σ and Δ of every recording with the standard errors of their elements."""
    rows: list[dict[str, Any]] = []
    for number, record in enumerate(result.records, start=1):
        noise = record.experiment.noise
        for quantity, estimate in _noise_estimates(noise).items():
            errors = estimate.std_error()
            rows += [
                {
                    "recording": number,
                    "quantity": quantity,
                    "row": i + 1,
                    "column": j + 1,
                    "covariance": estimate.covariance[i, j],
                    "std_error": errors[i, j],
                }
                for i, j in np.ndindex(6, 6)
            ]
    return pd.DataFrame(rows)


def motion_table(result: EstimationResult, number: int) -> pd.DataFrame:
    """Return measured and modelled quantities at the samples of one recording."""
    experiment = result.records[number].experiment
    best = result.best
    motion = best.motions[number]
    record = experiment.record
    basis = motion.basis(record.force_times)
    state = basis.state(motion.table)
    predicted = experiment.regressors(result.robot, motion) @ best.values
    blocks = [
        record.force_times[:, None] + record.origin,
        state,
        record.lengths,
        result.robot.inverse_kinematics(
            motion.basis(record.length_times).state(motion.table)[:, :6]
        ),
        record.forces,
        predicted,
    ]
    return pd.DataFrame(np.concatenate(blocks, axis=1), columns=[column.name for column in MOTION])


def estimate_record(
    result: EstimationResult, diagnosis: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Return what `estimate.json` states."""
    return {
        "units": "SI and radians",
        "name": result.configuration.run.name,
        "robot": result.robot.name,
        "parameters": list(result.knowledge.names),
        "fixed": [
            name
            for name, free in zip(result.knowledge.names, result.knowledge.free, strict=True)
            if not free
        ],
        "best": result.best.estimator,
        "recordings": [_recording(record) for record in result.records],
        "estimators": {
            name: _estimator(result, estimate) for name, estimate in result.estimates.items()
        },
        "cramer_rao_covariance": result.bound,
        "intervals_cover": result.intervals_cover,
        "intervals_note": (
            "95 %, with the noise of forces and lengths"
            if result.intervals_cover
            else "pointwise differentiation: the lengths' noise is in the regressor, which biases "
            "the estimates and is not in the intervals; they do not cover"
        ),
        "diagnostics": diagnosis,
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }


def _recording(summary: RecordSummary) -> dict[str, Any]:
    record, noise = summary.experiment.record, summary.experiment.noise
    fit = summary.experiment.fit
    return {
        "source": summary.source,
        "rows": record.rows,
        "dropped_rows": record.dropped,
        "samples": record.samples,
        "averaged": record.averaged,
        "periods": record.periods,
        "omega": record.omega if fit is None else fit.motion.omega,
        "omega_std": np.sqrt(fit.covariance[-1, -1])
        if fit is not None and fit.free_frequency
        else None,
        "period_source": record.source.value,
        "jitter": summary.jitter,
        "harmonics": summary.harmonics,
        "harmonics_of_the_design": None
        if summary.choice is None
        else summary.choice.design_harmonics,
        "noise": {
            "source": noise.source,
            "force_source": noise.force_source,
            "length_source": noise.length_source,
            "includes_model_error": noise.forces_include_model_error,
            "force_covariance": noise.force_covariance,
            "length_covariance": noise.length_covariance,
            "force_freedom": noise.force_freedom,
            "length_freedom": noise.length_freedom,
        },
    }


def _estimator(result: EstimationResult, estimate: ParameterEstimate) -> dict[str, Any]:
    return {
        "status": estimate.status,
        "converged": estimate.converged,
        "iterations": estimate.iterations,
        "cost": estimate.cost,
        "seconds": estimate.seconds,
        "values": dict(zip(result.knowledge.names, estimate.values.tolist(), strict=True)),
        "covariance": estimate.covariance,
        "covariance_forces": estimate.force_share,
        "covariance_kinematics": estimate.kinematic_share,
        "combinations": [
            {**asdict(combination), "text": combination.text}
            for combination in result.combinations[estimate.estimator]
        ],
        "motions": [
            _motion(motion.delayed(record.experiment.record.origin))
            for motion, record in zip(estimate.motions, result.records, strict=False)
        ],
    }


def _motion(motion: HarmonicMotion) -> dict[str, Any]:
    trajectory = motion.trajectory
    return {
        "harmonics": trajectory.harmonics,
        "omega": trajectory.omega,
        "lambda0": trajectory.lambda0,
        "mu": trajectory.mu,
        "nu": trajectory.nu,
    }


def _noise_estimates(noise: NoiseModel) -> dict[str, NoiseEstimate]:
    return {
        "force": NoiseEstimate(noise.force_covariance, noise.force_freedom),
        "length": NoiseEstimate(noise.length_covariance, noise.length_freedom),
    }
