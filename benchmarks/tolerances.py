"""PaLiDA, the design of n = 5: coverage with the truth drawn anew from the tolerances each time.

Ten periods of fewer samples than at 1 kHz, with as much less noise; a delay, which moves the jumps
of dry friction by whole samples, at 1 kHz itself. Every repetition draws all of θ, and the noise.
The controller follows the lengths of the design; a machine that these lengths take through a
singularity is drawn again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from benchmarks.studies import equivalent_run, palida_design
from constraints.arrays import Array
from estimation.estimators import ParameterEstimate
from estimation.identification.estimation import (
    add_systematic_uncertainty,
    parameter_priors,
    run_estimators,
)
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from estimation.twin.machine import draw_machine
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import InputError, RunConfiguration
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import toleranced_deviations

TITLE = "Truths drawn from the tolerances"

_SAMPLES, _AT_1_KHZ = 250, 1667
"""Of a period."""
_LEAST, _MOST = 0.93, 0.98

_JOINTS = {"base_joints": 1e-3, "platform_joints": 1e-3}
SECTIONS: dict[str, dict[str, Any]] = {
    "joints-0.1mm": {key: 0.1 * std for key, std in _JOINTS.items()},
    "joints-0.3mm": {key: 0.3 * std for key, std in _JOINTS.items()},
    "joints-1mm": _JOINTS,
    "force-constants": {"force_constant": {"common": 0.02, "each": 0.02}},
    "zeros": {"strut_length": 3e-4},
    "delay": {"delay": 1e-3},
    "channel-delays": {"channel_delay": {"forces": 5e-4, "lengths": 1e-4}},
    "channel-delays-2ms": {"channel_delay": {"forces": 2e-3, "lengths": 5e-4}},
    "low-pass-2ms": {"low_pass": {"forces": 2e-3, "lengths": 2e-4}},
    "low-pass-5ms": {"low_pass": {"forces": 5e-3}},
    "low-pass-and-delays": {
        "low_pass": {"forces": 3e-3, "lengths": 5e-4},
        "channel_delay": {"forces": 1e-3, "lengths": 1e-4},
    },
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
Drawn = tuple[dict[str, ParameterEstimate], Array]
"""The estimates of one repetition, without the influences, and what was drawn, (t,)."""


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield a row per estimator of a section."""
    count = repetitions or 200
    found: list[Drawn] = Parallel(n_jobs=2)(
        delayed(_repetition)(section, number) for number in range(count)
    )
    theta = np.array([values for _, values in found])
    gm = np.mean([estimates["gm, budget"].std for estimates, _ in found], axis=0)
    robot = robot_from(_run(section).robot)
    for name in found[0][0]:
        yield _row(name, [estimates[name] for estimates, _ in found], theta, robot, gm)


def summary(table: pd.DataFrame) -> str:
    """Return how many estimators cover."""
    return f"{int(np.sum(table['holds'] == 'yes'))} of {len(table)} cover 93 … 98 %"


def _run(section: str) -> RunConfiguration:
    samples = _AT_1_KHZ if "delay" in section else _SAMPLES
    return equivalent_run("tolerances", samples, tolerances=SECTIONS[section])


def _repetition(section: str, number: int) -> Drawn:
    run, rng = _run(section), np.random.default_rng([0, number])
    with threadpool_limits(limits=1):
        twin = None
        while twin is None:
            drawn = draw_machine(run, rng)
            with suppress(InputError):
                twin = Twin.of(drawn.configuration, palida_design(), seed=number)
        robot = robot_from(run.robot)
        knowledge, chosen = parameter_priors(run, robot), toleranced_deviations(robot)
        data = twin.measurement(1)
        experiments = [prepare_experiment(run, robot, data, palida_design())]
        plain = run_estimators(robot, experiments, knowledge, ("gm", "ml"))
        joint = run_estimators(robot, experiments, knowledge, ("ml",), chosen)
    estimates = {
        f"{name}, budget": add_systematic_uncertainty(found, knowledge, chosen)
        for name, found in plain.items()
    }
    return estimates | {"ml, estimated": joint["ml"]}, drawn.values


def _row(
    name: str, estimates: Sequence[ParameterEstimate], theta: Array, robot: Robot, gm: Array
) -> Row:
    errors = np.array([np.abs(estimate.values - robot.parameters) for estimate in estimates])
    std = np.array([estimate.std for estimate in estimates])
    widths = np.array([interval_widths(estimate.freedom) for estimate in estimates])
    random = np.sqrt([np.diag(estimate.covariance_random) for estimate in estimates])
    covers = np.mean(errors < widths * std, axis=1)
    nearer = ""
    systematic = [each.systematic for each in estimates if each.systematic]
    if systematic and systematic[0].estimated:
        off = _seen(np.array([each.values for each in systematic]) - theta, robot)
        nearer = f"{np.linalg.norm(off) / np.linalg.norm(_seen(theta, robot)):.2f}"
    return {
        "estimator": name,
        "repetitions": len(estimates),
        "95 % intervals cover (%)": f"{100 * covers.mean():.1f} ± "
        f"{100 * covers.std() / np.sqrt(len(estimates)):.1f}",
        "the random share alone would (%)": f"{100 * np.mean(errors < widths * random):.1f}",
        "median of std / that of GM": f"{np.median(std.mean(axis=0) / gm):.2f}",
        "RMS error of θ / drawn": nearer,
        "holds": "yes" if _LEAST <= covers.mean() <= _MOST else "no",
    }


def _seen(theta: Array, robot: Robot) -> Array:
    """Return deviations, (K, t), in their tolerances, without what no measurement sees.

    All joints of the base, or of the platform, that are shifted or turned together are the same
    machine in another frame.
    """
    chosen = toleranced_deviations(robot)
    scaled = theta / np.array([each.tolerance for each in chosen])
    frames = (
        ("base_joints", robot.description.base_joints),
        ("platform_joints", robot.description.platform_joints),
    )
    for group, joints in frames:
        places = [k for k, each in enumerate(chosen) if each.group == group]
        if places:
            axes = np.eye(3)
            shifts = [np.tile(axis, len(joints)) for axis in axes]
            turns = [np.cross(axis, joints).ravel() for axis in axes]
            basis = np.linalg.qr(np.array([*shifts, *turns]).T)[0]
            own = scaled[:, places]
            scaled[:, places] = own - own @ basis @ basis.T
    return scaled
