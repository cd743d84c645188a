"""PaLiDA, n = 5, 10 periods at 1 kHz: design, XPS table, its execution, estimates.

The table is read again and its Hermite polynomials are executed by the digital twin; the estimates
from K measurements are held against the standard deviations that the design predicts.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.studies import CLEAR_BIAS
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration, export_section, load_run
from expdesign.export.definition import Task
from expdesign.export.exporting import export_table
from expdesign.export.table_file import read_table_file
from expdesign.information.fisher import information_matrix, parameter_covariance
from expdesign.motion.planning import executable_motion
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

TITLE = "Round trip over a controller table"

Array = NDArray[np.float64]
Row = dict[str, Any]

REPETITIONS = 200
LOW, HIGH = 0.93, 1.07
ESTIMATORS = ("gm", "ml")
_IDENTIFIED = 0.5


def rows() -> Iterator[Row]:
    """Yield the rows of the table."""
    design = TrajectoryFile.read(Path(__file__).parent / "designs" / "palida.json").trajectory
    run = load_run({"name": "roundtrip", "robot": "palida", "estimate": {"noise": "given"}})
    robot = robot_from(run.robot)
    with TemporaryDirectory() as folder:
        twin, said = _executed(run, robot, design, Path(folder) / "palida.trj")
    yield said
    covariance = _predicted(run, robot, design)
    std = np.sqrt(np.diag(covariance))
    identified = std < _IDENTIFIED * np.abs(robot.parameters)
    correlation = (covariance / np.multiply.outer(std, std))[np.ix_(identified, identified)]
    # Of the root of K draws' mean square, whose errors are correlated.
    uncertain = float(np.sqrt(2 / (REPETITIONS - 1) * np.mean(correlation**2)) / 2)
    for name, values in _estimates(run, robot, twin, design).items():
        errors = ((values - robot.parameters) / std)[:, identified]
        share = errors.std(axis=0, ddof=1)
        rms = float(np.sqrt(np.mean(share**2)))
        yield _row(
            f"{name}: achieved / predicted standard deviation in {LOW} … {HIGH}, rms over the "
            f"{identified.sum()} identified parameters, {REPETITIONS} repetitions",
            f"{rms:.3f} ± {uncertain:.3f}",
            LOW <= rms <= HIGH,
        )
        names = np.array(robot.parameter_names)[identified]
        low, high = int(np.argmin(share)), int(np.argmax(share))
        yield _row(
            f"{name}: of single parameters",
            f"{share[low]:.2f} ({names[low]}) … {share[high]:.2f} ({names[high]})",
        )
        bias = np.abs(errors.mean(axis=0)) / (share / np.sqrt(REPETITIONS))
        worst = int(np.argmax(bias))
        yield _row(
            f"{name}: bias of all of them within {CLEAR_BIAS:g} standard errors",
            f"{bias[worst]:.2f} ({names[worst]})",
            bool(bias[worst] <= CLEAR_BIAS),
        )


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    judged = table[table["holds"] != ""]
    return f"{int((judged['holds'] == 'yes').sum())} of {len(judged)} claims hold"


def _executed(
    run: RunConfiguration, robot: Robot, design: FourierTrajectory, path: Path
) -> tuple[Twin, Row]:
    motion = executable_motion(run, design)
    task = Task(
        name="roundtrip",
        robot=robot,
        motion=motion,
        controller_period=run.run.controller_period,
        sampling=run.run.experiment.sampling,
        parameters=robot.parameter_names,
        force_covariance=_force_covariance(run),
    )
    made = export_table(export_section(format="xps-pvt"), task, path)
    table = read_table_file(path, made.settings)
    twin = Twin.of(run, table)
    error = 0.0 if twin.truth.table is None else twin.truth.table.position_error
    check = made.check
    said = _row(
        "the table",
        f"{check.rows} rows, {1e3 * check.shortest_step:g} to {1e3 * check.longest_step:g} ms "
        "apart, "
        f"{check.duration:.3f} s, of which {motion.window[1] - motion.window[0]:.3f} s are "
        f"measured; struts within {1e6 * error:.2g} µm of the design",
    )
    return twin, said


def _predicted(run: RunConfiguration, robot: Robot, design: FourierTrajectory) -> Array:
    """Return F⁻¹ of the whole experiment: the `predicted_std.experiment` of a design, squared."""
    section = run.run.experiment
    states = design.sample(design.sample_times(round(design.period * section.sampling)))
    regressors = robot.regressor(states.pose, states.rate, states.acceleration)
    information = section.periods * information_matrix(regressors, _force_covariance(run))
    return parameter_covariance(information, robot.parameter_names)


def _estimates(
    run: RunConfiguration, robot: Robot, twin: Twin, design: FourierTrajectory
) -> dict[str, Array]:
    knowledge = parameter_priors(run, robot)
    found: dict[str, list[Array]] = {name: [] for name in ESTIMATORS}
    with threadpool_limits(limits=1, user_api="blas"):
        for number in range(1, REPETITIONS + 1):
            experiment = prepare_experiment(run, robot, twin.measurement(number), design)
            estimates = run_estimators(robot, [experiment], knowledge, ESTIMATORS)
            for name in ESTIMATORS:
                found[name].append(estimates[name].values)
    return {name: np.array(values) for name, values in found.items()}


def _force_covariance(run: RunConfiguration) -> Array:
    noise = run.robot.noise
    if noise is None or noise.force_covariance is None:
        raise ValueError("the robot states no noise of its forces")
    return noise.force_covariance


def _row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
