"""A floor-standing machine with ball screws: design, recordings, estimates; its inertia left out.

The machine is that of docs/own-machine.md as `expdesign init` writes it, 99.5 kg along each strut,
with screws that the platform turns on their threads. Its estimates are held against the truth by
the joint χ² of the parameters' errors, without bias the number of parameters on average. Then the
same recordings are taken for those of direct drives.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

import expdesign
from constraints.arrays import Array
from estimation.diagnostics.diagnosis import diagnose
from estimation.identification import estimate_parameters
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.configuration import load_run
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.machines.importing import MachineDescription, machine_from_answers
from expdesign.machines.writing import write_files
from expdesign.mechanism.terms.actuator_forces import DRIVE_MASS as MASS
from expdesign.robot import robot_from

TITLE = "A machine with ball screws"

Row = dict[str, Any]

REPETITIONS, LEFT_OUT = 40, 10
ESTIMATORS = ("gm", "ml")
_CLEAR = 3.0
"""Standard errors by which a mean is off when it is not by chance."""

_TOLD = {
    "name": "press",
    "base_radius": 0.45,
    "base_half_angle": "8 deg",
    "platform_radius": 0.25,
    "platform_half_angle": "12 deg",
    "platform_z": -0.05,
    "home_height": 0.7,
    "strut_length": [0.6, 0.9],
    "strut_speed": 0.3,
    "actuator_force": 2000,
    "mass": 64,
    "drive": "screw",
    "lead": 5e-3,
    "inertia": 6.3e-5,
    "force_std": 20,
    "length_std": 5e-5,
}


def rows() -> Iterator[Row]:
    """Yield the rows of the table."""
    mapping = _run()
    result = expdesign.design(mapping)
    yield _row(
        "the design keeps every limit and its search ended",
        f"{result.status}, {result.solver.seconds:.0f} s",
        result.status == "converged",
    )
    run, robot, design = load_run(mapping), result.robot, result.trajectory
    twin = Twin.of(run, design)
    states = design.sample(design.sample_times(400))
    mass = robot.parameters[robot.parameter_names.index(MASS)]
    own = mass * robot.strut_motion(*states).length_acceleration
    share = float(np.std(own) / np.std(robot.actuator_forces(*states)))
    yield _row(
        f"the inertia of the drives, {mass:.1f} kg, makes of the forces' rms", f"{share:.2f}"
    )
    knowledge, truth = parameter_priors(run, robot), robot.parameters
    squares: dict[str, list[float]] = {name: [] for name in ESTIMATORS}
    errors: dict[str, list[Array]] = {name: [] for name in ESTIMATORS}
    with threadpool_limits(limits=1, user_api="blas"):
        for number in range(1, REPETITIONS + 1):
            experiment = prepare_experiment(run, robot, twin.measurement(number), design)
            found = run_estimators(robot, [experiment], knowledge, ESTIMATORS)
            for name in ESTIMATORS:
                error = found[name].values - truth
                squares[name].append(float(error @ np.linalg.solve(found[name].covariance, error)))
                errors[name].append(error / found[name].std)
        for name in ESTIMATORS:
            yield from _unbiased(name, np.array(squares[name]), np.array(errors[name]), robot)
        yield from _left_out(mapping, twin, result)


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    judged = table[table["holds"] != ""]
    return f"{int((judged['holds'] == 'yes').sum())} of {len(judged)} claims hold"


def _run() -> dict[str, Any]:
    """Return the run of the machine."""
    document = document_from_mapping(_TOLD)
    machine = machine_from_answers(Located(MachineDescription.model_validate(_TOLD), document))
    with TemporaryDirectory() as folder:
        files = write_files(machine, Path(folder))
        robot = load_run(files.run).robot.description.model_dump(mode="json", by_alias=True)
    # Cardan joints at the platform that stand as those at the base, and a little turned.
    turn = 0.2 * np.random.default_rng(1).normal(size=(6, 3))
    robot["platform_cardan_axes"] = (np.array(robot["alpha_axes"]) + turn).tolist()
    return {
        "name": "screws",
        "robot": robot,
        "trajectory": {"harmonics": 3, "frequency": ["0.12 Hz", "0.6 Hz"], "samples": 40},
        "design": {"starts": 1, "search": "restarts", "seed": 0},
        "experiment": {"periods": 10, "sampling": "250 Hz"},
        "estimate": {"estimators": list(ESTIMATORS), "noise": "given"},
        "workers": 1,
    }


def _unbiased(name: str, squares: Array, errors: Array, robot: Any) -> Iterator[Row]:
    count, freedom = errors.shape
    mean, uncertain = float(np.mean(squares)), float(np.sqrt(2 * freedom / count))
    yield _row(
        f"{name}: mean χ² of {freedom} parameters over {count} recordings",
        f"{mean:.1f} ± {uncertain:.1f}",
        abs(mean - freedom) <= _CLEAR * uncertain,
    )
    bias = np.mean(errors, axis=0) * np.sqrt(count)
    drive = robot.parameter_names.index(MASS)
    worst = int(np.argmax(np.abs(bias)))
    yield _row(
        f"{name}: mean error of {MASS}, in standard errors; the largest of all",
        f"{bias[drive]:.1f}; {bias[worst]:.1f} ({robot.parameter_names[worst]})",
        bool(abs(bias[drive]) <= _CLEAR),
    )


def _left_out(mapping: dict[str, Any], twin: Twin, result: Any) -> Iterator[Row]:
    robot = mapping["robot"] | {"drive": "direct", "platform_cardan_axes": None}
    robot["parameters"] = {k: v for k, v in robot["parameters"].items() if k != MASS}
    run = load_run(mapping | {"robot": robot, "limits": {"rotation": "none"}})
    robot_from(run.robot)
    first: Counter[str] = Counter()
    sizes = []
    for number in range(1, LEFT_OUT + 1):
        found = estimate_parameters(run, twin.measurement(number), result.trajectory)
        diagnosis = diagnose(found.robot, found.experiments, found.priors, found.best)
        effects = diagnosis.recordings[0].attribution.effects
        first[effects[0].kind if effects else "nothing"] += 1
        sizes += [effects[0].value] if effects and effects[0].kind == "drive_inertia" else []
    named = ", ".join(f"{kind} {count}" for kind, count in first.items())
    yield _row(
        f"taken for direct drives: what is named first in {LEFT_OUT} recordings",
        f"{named}; {np.mean(sizes):.1f} kg" if sizes else named,
        first["drive_inertia"] == LEFT_OUT,
    )


def _row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
