"""PaLiDA, the design of n = 5: coverage with the truth drawn anew from the tolerances each time.

Noise and samples are those of 10 periods at 1 kHz, in fewer samples with as much less noise. What
every repetition draws is θ, all of it at once, and the noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.estimators import ParameterEstimate
from estimation.identification.estimate import parameter_knowledge, run_estimators, with_budget
from estimation.identification.recording import prepare_experiment
from expdesign.configuration import RunConfiguration, load_run
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import Deviation, deviated, tolerated
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

TITLE = "Truths drawn from the tolerances"

_DESIGN = Path(__file__).parent / "designs" / "palida.json"
_PERIODS, _SAMPLES = 3, 250
_QUIETER = np.sqrt(_PERIODS * _SAMPLES / 16_670)
_NORMAL = 1.96
_LEAST, _MOST = 0.93, 0.98

_JOINTS = {"base_joints": 1e-3, "platform_joints": 1e-3}
SECTIONS: dict[str, dict[str, Any]] = {
    "joints-0.1mm": {key: 0.1 * std for key, std in _JOINTS.items()},
    "joints-0.3mm": {key: 0.3 * std for key, std in _JOINTS.items()},
    "joints-1mm": _JOINTS,
    "force-constants": {"force_constant": {"common": 0.02, "each": 0.02}},
    "zeros": {"strut_length": 3e-4},
    "delay": {"delay": 1e-3},
    "gravity": {"gravity": 0.01},
    "all": {
        **_JOINTS,
        "force_constant": {"common": 0.02, "each": 0.02},
        "strut_length": 3e-4,
        "delay": 1e-3,
        "gravity": 0.01,
    },
}

Row = dict[str, Any]


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield a row per estimator of a section."""
    configuration = _configuration(SECTIONS[section])
    robot = robot_from(configuration.robot)
    chosen, design = tolerated(robot), TrajectoryFile.read(_DESIGN).trajectory
    found: dict[str, list[tuple[ParameterEstimate, Array]]] = {}
    for number in range(repetitions or 200):
        rng = np.random.default_rng([0, number])
        theta = np.array([each.std for each in chosen]) * rng.normal(size=len(chosen))
        data = _measured(robot, chosen, theta, design, rng)
        for name, estimate in _estimates(configuration, robot, data, design).items():
            found.setdefault(name, []).append((estimate, theta))
    gm = np.mean([estimate.std for estimate, _ in found["gm, budget"]], axis=0)
    for name, results in found.items():
        yield _row(name, results, robot.parameters, gm)


def summary(table: pd.DataFrame) -> str:
    """Return how many estimators cover."""
    return f"{int(np.sum(table['holds'] == 'yes'))} of {len(table)} cover 93 … 98 %"


def _configuration(tolerances: dict[str, Any]) -> RunConfiguration:
    run = {"name": "tolerances", "robot": "palida"}
    noise = load_run(run).robot.noise
    if noise is None or noise.force_covariance is None or noise.length_covariance is None:
        raise AssertionError("PaLiDA states its noise")
    return load_run(
        {
            **run,
            "tolerances": tolerances,
            "noise": {
                "force_covariance": (noise.force_covariance * _QUIETER**2).tolist(),
                "length_covariance": (noise.length_covariance * _QUIETER**2).tolist(),
            },
            "estimate": {"harmonics": 5, "noise": "given"},
        }
    )


def _measured(
    robot: Robot,
    chosen: Sequence[Deviation],
    theta: Array,
    motion: FourierTrajectory,
    rng: np.random.Generator,
) -> Measurement:
    """Return what a machine measures that deviates by θ."""
    own = dict(zip((each.name for each in chosen), theta.tolist(), strict=True))
    each = {
        name: np.array([own.get(f"{name}_{j}", 0.0) for j in range(1, 7)])
        for name in ("strut_length", "force_constant")
    }
    machine, step = deviated(robot, chosen, theta), motion.period / _SAMPLES
    times = np.arange(_SAMPLES) * step
    lengths = machine.inverse_kinematics(motion.sample(times).pose) + each["strut_length"]
    late = motion.sample(times - own.get("delay", 0.0))
    forces = machine.actuator_forces(late.pose, late.rate, late.acceleration)
    forces = forces * (1 + own.get("force_constant", 0.0) + each["force_constant"])
    noise = robot.description.noise
    if noise is None or noise.force_covariance is None or noise.length_covariance is None:
        raise AssertionError("the run states the noise")

    def measured(values: Array, covariance: Array) -> Array:
        """Return all periods with their noise."""
        draws = rng.normal(size=(_PERIODS * _SAMPLES, 6))
        return np.tile(values, (_PERIODS, 1)) + draws @ np.linalg.cholesky(covariance).T

    return Measurement(
        np.arange(_PERIODS * _SAMPLES, dtype=np.float64) * step,
        measured(lengths, noise.length_covariance),
        measured(forces, noise.force_covariance),
        step,
    )


def _estimates(
    configuration: RunConfiguration, robot: Robot, data: Measurement, design: FourierTrajectory
) -> dict[str, ParameterEstimate]:
    knowledge, chosen = parameter_knowledge(configuration, robot), tolerated(robot)
    experiments = [prepare_experiment(configuration, robot, data, design)]
    plain = run_estimators(robot, experiments, knowledge, ("gm", "ml"))
    joint = run_estimators(robot, experiments, knowledge, ("ml",), chosen)
    budgets = {
        f"{name}, budget": with_budget(found, knowledge, chosen) for name, found in plain.items()
    }
    return {**budgets, "ml, estimated": joint["ml"]}


def _row(
    name: str, results: Sequence[tuple[ParameterEstimate, Array]], truth: Array, gm: Array
) -> Row:
    errors = np.array([np.abs(estimate.values - truth) for estimate, _ in results])
    std = np.array([estimate.std for estimate, _ in results])
    random = np.sqrt([np.diag(estimate.covariance_random) for estimate, _ in results])
    covers = np.mean(errors < _NORMAL * std, axis=1)
    first = results[0][0].systematic
    nearer = ""
    if first is not None and first.estimated:
        off = np.array([e.systematic.values - theta for e, theta in results if e.systematic])
        drawn = np.array([theta for _, theta in results])
        nearer = f"{np.linalg.norm(off) / np.linalg.norm(drawn):.2f}"
    return {
        "estimator": name,
        "repetitions": len(results),
        "95 % intervals cover (%)": f"{100 * covers.mean():.1f} ± "
        f"{100 * covers.std() / np.sqrt(len(results)):.1f}",
        "the random share alone would (%)": f"{100 * np.mean(errors < _NORMAL * random):.1f}",
        "median of std / that of GM": f"{np.median(std.mean(axis=0) / gm):.2f}",
        "RMS error of θ / drawn": nearer,
        "holds": "yes" if _LEAST <= covers.mean() <= _MOST else "no",
    }
