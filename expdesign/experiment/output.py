"""The files of a design in its run folder. Values are SI and radians."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from expdesign.configuration import resolved_yaml
from expdesign.experiment.result import DesignResult, PredictedPrecision, whole
from expdesign.experiment.scaling import parameter_scaling
from expdesign.experiment.tables import TABLES
from expdesign.information.catalogue import criteria_by_key
from expdesign.information.fisher import ScaledInformation
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import TRAJECTORY, add_columns


def write_design(result: DesignResult, folder: Path) -> list[Path]:
    """Write `run.yaml`, `design.json`, `trajectory.csv`, `columns.json` and `tables/`.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "limits": limits_table(result),
        "parameters": parameters_table(result),
        "starts": starts_table(result),
        "convergence": convergence_table(result),
        "eigenvalues": eigenvalues_table(result),
        "information": information_table(result),
    }
    written = []
    for name, table in tables.items():
        path = folder / "tables" / f"{name}.csv"
        write_csv(path, table)
        written.append(path)
    trajectory = folder / "trajectory.csv"
    write_csv(trajectory, trajectory_table(result))
    columns = {"trajectory.csv": TRAJECTORY}
    columns |= {f"tables/{name}.csv": TABLES[name] for name in tables if name in TABLES}
    add_columns(folder, columns)
    write_json(folder / "design.json", design_record(result))
    write_text(folder / "run.yaml", resolved_yaml(result.configuration))
    return [
        *written,
        trajectory,
        *(folder / name for name in ("columns.json", "design.json", "run.yaml")),
    ]


def design_record(result: DesignResult) -> dict[str, Any]:
    """Return what `design.json` states."""
    trajectory, search, run = result.trajectory, result.search, result.configuration.run
    stages = list(chain.from_iterable(start.stages for start in search.starts))
    finish = search.finished.record
    stages += [finish] if finish is not None else []
    evaluations: dict[str, int] = {}
    for stage in stages:
        for part, count in stage.evaluations.items():
            evaluations[part] = evaluations.get(part, 0) + count
    return {
        "units": "SI and radians",
        "name": run.name,
        "robot": result.robot.name,
        "criterion": run.design.criterion,
        "scaling": run.design.scaling,
        "parameters": list(result.parameter_names),
        "harmonics": trajectory.harmonics,
        "omega": trajectory.omega,
        "frequency_hz": trajectory.frequency,
        "period": trajectory.period,
        "controller_period": run.trajectory.controller_period,
        "samples_per_period": whole(result.samples_per_period) or result.samples_per_period,
        "samples": result.samples,
        "lambda0": trajectory.lambda0,
        "mu": trajectory.mu,
        "nu": trajectory.nu,
        "log_det_information": result.log_det_information,
        "criterion_value": result.criterion_value,
        "predicted_std": {
            "per_period": _precision(result.per_period),
            "experiment": _precision(result.experiment),
        },
        "status": result.status,
        "status_text": result.status_text,
        "solver": {
            "name": "Ipopt through CasADi",
            "iterations": sum(stage.iterations for stage in stages),
            "evaluations": evaluations,
            "seconds": search.seconds,
            "best_start": search.best.index,
            "finish": {
                "shrink": search.finished.shrink,
                "record": None if finish is None else asdict(finish),
            },
            "starts": [
                {
                    "index": start.index,
                    "kind": start.kind,
                    "status": start.status,
                    "converged": start.converged,
                    "iterations": start.iterations,
                    "criterion_value": _value(result, start.merit),
                    "finished_value": _finished_value(result, start.index),
                    "seconds": start.seconds,
                    "stages": [asdict(stage) for stage in start.stages],
                }
                for start in search.starts
            ],
        },
        "limits": {
            check.key: {
                "value": check.value,
                "bound": check.bound,
                "unit": check.unit,
                "row": check.row,
                "strut": _strut(check.row),
                "time": check.time,
                "violation": check.violation,
                "origin": check.origin,
                "certified": False,
                "method": result.check.method,
            }
            for check in result.check.limits
        },
        "warnings": list(result.warnings),
    }


def trajectory_table(result: DesignResult) -> pd.DataFrame:
    """Return one period at the controller's rate, rounded to a whole number of rows."""
    times = result.trajectory.sample_times(round(result.samples_per_period))
    motion = result.trajectory.sample(times)
    struts = result.robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
    forces = result.robot.actuator_forces(motion.pose, motion.rate, motion.acceleration)
    blocks = [
        times[:, None],
        motion.pose,
        motion.rate,
        motion.acceleration,
        struts.length,
        struts.length_rate,
        struts.length_acceleration,
        struts.alpha,
        struts.beta,
        forces,
    ]
    return pd.DataFrame(
        np.concatenate(blocks, axis=1), columns=[column.name for column in TRAJECTORY]
    )


def limits_table(result: DesignResult) -> pd.DataFrame:
    """Return the worst moment of every limit."""
    return pd.DataFrame(
        [
            {
                "limit": check.key,
                "title": check.title,
                "row": check.row,
                "unit": check.unit,
                "value": check.value,
                "bound": check.bound,
                "violation": check.violation,
                "time": check.time,
                "origin": check.origin,
            }
            for check in result.check.limits
        ],
        columns=[column.name for column in TABLES["limits"]],
    )


def parameters_table(result: DesignResult) -> pd.DataFrame:
    """Return nominal value and predicted standard deviation of every judged parameter."""
    nominal = result.robot.description.parameters
    rows = []
    for name in result.parameter_names:
        size = abs(nominal[name])
        period, experiment = result.per_period.std[name], result.experiment.std[name]
        rows.append(
            {
                "parameter": name,
                "unit": parameter_unit(name),
                "nominal": nominal[name],
                "std_per_period": period,
                "std_experiment": experiment,
                "rel_std_percent_per_period": 100 * period / size if size else np.nan,
                "rel_std_percent_experiment": 100 * experiment / size if size else np.nan,
            }
        )
    return pd.DataFrame(rows)


def starts_table(result: DesignResult) -> pd.DataFrame:
    """Return one row per start and hop; no times, so that it is the same for the same seed."""
    return pd.DataFrame(
        [
            {
                "start": start.index,
                "kind": start.kind,
                "criterion_value": _value(result, start.merit),
                "finished_value": _finished_value(result, start.index),
                "iterations": start.iterations,
                "converged": start.converged,
                "status": start.status,
                "best": start.index == result.search.best.index,
            }
            for start in result.search.starts
        ]
    )


def convergence_table(result: DesignResult) -> pd.DataFrame:
    """Return objective and violation over the iterations of every start."""
    best = result.search.best
    rows = [
        (start.index, start.kind, p.stage, p.iteration, p.objective, p.violation)
        for start in result.search.starts
        for p in (
            *start.trace,
            *(
                replace(q, iteration=start.iterations + q.iteration)
                for q in (result.search.finished.trace if start is best else ())
            ),
        )
    ]
    return pd.DataFrame(
        rows,
        columns=[column.name for column in TABLES["convergence"]],
    )


def eigenvalues_table(result: DesignResult) -> pd.DataFrame:
    """Return the eigenvalues of F scaled to unit diagonal, and scaled by nominal values."""
    every = result.robot.parameter_names
    columns = [every.index(name) for name in result.parameter_names]
    sizes = parameter_scaling(result.robot, "nominal")[columns]
    by_nominal = result.information * np.multiply.outer(sizes, sizes)
    values = ScaledInformation.of(result.information).eigenvalues()
    return pd.DataFrame(
        {
            "index": np.arange(1, len(values) + 1),
            "eigenvalue": values,
            "eigenvalue_nominal": np.linalg.eigvalsh(by_nominal),
        }
    )


def information_table(result: DesignResult) -> pd.DataFrame:
    """Return F of one period, SI, with the parameters' names as row and column heads."""
    table = pd.DataFrame(result.information, columns=list(result.parameter_names))
    table.insert(0, "parameter", list(result.parameter_names))
    return table


def _precision(precision: PredictedPrecision) -> dict[str, float]:
    return {"samples": precision.samples, "periods": precision.periods, **precision.std}


def _value(result: DesignResult, merit: float) -> float:
    criterion = criteria_by_key()[result.configuration.run.design.criterion]
    return merit if criterion.larger_is_better else -merit


def _finished_value(result: DesignResult, index: int) -> float | None:
    merit = result.search.finished_merits.get(index)
    return None if merit is None else _value(result, merit)


def _strut(row: str) -> int | None:
    return int(row.removeprefix("strut ")) if row.startswith("strut ") else None
