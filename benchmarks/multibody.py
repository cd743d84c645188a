"""PaLiDA in the simulator MuJoCo: forces against the model's, recordings identified.

The simulation is that of `tests/multibody`, in shorter steps. Each case is a machine of which K
recordings are made, alike but for the noise: 10 periods at 1 kHz with the noise of the robot file.
The joint χ² of the parameters' errors is taken with the estimated covariance.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2, norm
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.data.reading import read_measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.identification import estimate_parameters
from expdesign.configuration import load_run
from expdesign.robot import Robot, load_robot
from expdesign.trajectory import TrajectoryFile
from tests.multibody.driven import COMPENSATED, Driven, drive, motion
from tests.multibody.inverse import ExactMachine
from tests.multibody.machine import Bodies, Geometry
from tests.multibody.recording import DATA, write_recording

TITLE = "A machine in a multibody simulator"

Row = dict[str, Any]

SAMPLES, PERIODS = 1667, 10
STEP = 0.1e-3
"""Of the simulation [s]."""

ESTIMATORS = ("gm", "ml")
LEVEL = 0.999
FORCES_ALIKE = 1e-8
"""N, largest difference of forces that counts as none."""

REPEATS = 1e-9
"""m, largest difference of two periods that counts as none."""

_DESIGN = Path(__file__).parent / "designs" / "palida.json"
_INTERVAL = 0.95


_BODIES = Bodies()
_OFF = replace(_BODIES.slider, centre=(0.005, 0, _BODIES.slider.centre[2]))


@dataclass(frozen=True)
class Case:
    """A machine, how it is driven, and how its recordings are estimated."""

    repetitions: int
    bodies: Bodies = _BODIES
    compensated: float = COMPENSATED
    noise: str = "auto"
    claimed: bool = False
    """Whether the truth is expected within the joint confidence region."""


CASES = {
    "the machine of the model": Case(20, claimed=True),
    "the same, noise covariance given": Case(20, noise="given", claimed=True),
    "dry friction not compensated by the controller": Case(6, compensated=0.0),
    "sliders with a centre 5 mm off the strut's axis": Case(
        6, bodies=replace(_BODIES, slider=_OFF)
    ),
}
"""Cases of recordings; the last ones are machines that the model is not of."""

SECTIONS = ("forces", "recordings")


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` of each case instead of its own number."""
    if section == "forces":
        yield from _forces()
        return
    for name, case in CASES.items():
        count = repetitions or case.repetitions
        yield from _recordings(name, replace(case, repetitions=count))


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    judged = table[table["holds"] != ""]
    return f"{int((judged['holds'] == 'yes').sum())} of {len(judged)} claims hold"


def _forces() -> Iterator[Row]:
    robot, design = load_robot("palida"), json.loads(_DESIGN.read_text(encoding="utf-8"))
    geometry, bodies = Geometry.of(robot), _BODIES
    times = 2 * np.pi / design["omega"] / SAMPLES * np.arange(SAMPLES)
    states: tuple[Array, Array, Array] = motion(design, times)
    exact = ExactMachine(geometry, bodies).simulate(*states)
    forces = robot.actuator_forces(*states, bodies.parameters(geometry.platform_joints))
    off = float(np.abs(exact.forces - forces).max())
    yield _row(
        f"largest difference of the forces along the design at most {FORCES_ALIKE:g} N",
        f"{off:.1e} N, of {np.abs(forces).max():.0f} N",
        off <= FORCES_ALIKE,
    )
    lengths = float(np.abs(exact.lengths - robot.inverse_kinematics(states[0])).max())
    yield _row("largest difference of the lengths", f"{lengths:.1e} m")
    driven = drive(geometry, bodies, design, SAMPLES, periods=3, longest=STEP)
    periods = driven.lengths.reshape(3, SAMPLES, -1)
    apart = float(np.abs(periods - periods[0]).max())
    yield _row(
        f"three periods of the driven machine repeat within {REPEATS:g} m",
        f"{apart:.1e} m",
        apart <= REPEATS,
    )
    yield _row("widest gap in a loop", f"{1e6 * driven.gap:.2f} µm")
    rms = float(np.sqrt(np.mean(driven.tracking**2)))
    yield _row("tracking error of the lengths, rms", f"{1e6 * rms:.0f} µm")


def _recordings(name: str, case: Case) -> Iterator[Row]:
    robot = load_robot("palida")
    geometry = Geometry.of(robot)
    truth = case.bodies.parameters(geometry.platform_joints)
    design = json.loads(_DESIGN.read_text(encoding="utf-8"))
    driven = drive(
        geometry, case.bodies, design, SAMPLES, compensated=case.compensated, longest=STEP
    )
    found: dict[str, list[tuple[float, Array]]] = {key: [] for key in ESTIMATORS}
    verdicts: Counter[str] = Counter()
    with TemporaryDirectory() as folder, threadpool_limits(limits=1, user_api="blas"):
        for seed in range(1, case.repetitions + 1):
            path = Path(folder) / "log.csv"
            estimates, verdict = _identify(robot, case, driven, path, seed)
            verdicts[verdict] += 1
            for key, (values, covariance) in estimates.items():
                error = values - truth
                square = float(error @ np.linalg.solve(covariance, error))
                found[key].append((square, error / np.sqrt(np.diag(covariance))))
    limit = float(chi2.ppf(LEVEL, len(truth)))
    for key, pairs in found.items():
        squares = np.array([square for square, _ in pairs])
        errors = np.array([error for _, error in pairs])
        inside = int(np.sum(squares < limit))
        covered = float(np.mean(np.abs(errors) < norm.ppf((1 + _INTERVAL) / 2)))
        means = errors.mean(axis=0)
        worst = int(np.argmax(np.abs(means)))
        yield {
            "machine": name,
            "estimator": key,
            "first recording's χ²": f"{squares[0]:.1f}",
            f"mean χ² of {len(truth)}": _mean(squares),
            f"below {limit:.1f}": f"{inside} of {len(squares)}",
            "95 % intervals cover": f"{100 * covered:.1f} %",
            "largest mean error": f"{means[worst]:.1f}σ ({robot.parameter_names[worst]})",
            "verdict": ", ".join(f"{word} {n}" for word, n in verdicts.items()),
            "holds": ("no", "yes")[bool(squares[0] < limit)] if case.claimed else "",
        }


def _identify(
    robot: Robot, case: Case, driven: Driven, path: Path, seed: int
) -> tuple[dict[str, tuple[Array, Array]], str]:
    """Make a recording, and return values and covariance of each estimator, and the verdict."""
    noise = robot.description.noise
    if noise is None:
        raise ValueError("the robot states no noise")
    write_recording(path, driven, PERIODS, (noise.length_covariance, noise.force_covariance), seed)
    section = {"estimators": list(ESTIMATORS), "noise": case.noise}
    run = load_run({"name": "multibody", "robot": "palida", "data": DATA, "estimate": section})
    data = read_measurement(path, run.run.data, robot)
    result = estimate_parameters(run, data, TrajectoryFile.read(_DESIGN).trajectory)
    diagnosis = diagnose(result.robot, result.experiments, result.priors, result.best)
    return (
        {key: (one.values, one.covariance) for key, one in result.estimates.items()},
        diagnosis.verdict.status.value,
    )


def _mean(values: Array) -> str:
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return f"{np.mean(values):.1f} ± {error:.1f}"


def _row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
