"""Single motions without a repetition: coverage and precision, against common practice.

The machine is the independent simulator `tests/unknowns/simulator.py`. It executes passes of a
design once, from rest to rest with ramps of the speed; nothing of the noise is stated. Common
practice is forward kinematics, a zero-phase low pass, central differences and least squares with
standard deviations of white residuals; its cut-off is three times the highest harmonic. It has no
result where a sample's noisy lengths have no pose.
``make bench ARGS="shots palida --repetitions 20"`` runs few of the recordings. Results of a commit
are kept in ``build/shots``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from benchmarks import unknowns
from benchmarks.kept import keep
from estimation.data.measurement import Measurement
from estimation.estimators import ParameterPriors
from estimation.identification import prepare_experiment, run_estimators
from estimation.kinematics import MotionFitError
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import load_run
from expdesign.robot import robot_from
from tests.unknowns.simulator import draw_noise, read_noise, simulate

TITLE = "Motions without a period"

SECTIONS = ("palida", "irregular")
"""Machines, each with its design."""
DRAWS = 200
_RAMP, _RATE = 1.0, 200.0
"""Duration of a ramp, s, and samples per second."""
_PASSES = 4.0
_CASES = {
    "white noise": (0.0, 1.0),
    "AR(1), 0.9": (0.9, 1.0),
    "AR(1), 0.99": (0.99, 1.0),
    "10 times the length noise": (0.0, 10.0),
}
"""Correlation of the forces' noise from sample to sample, and factor of the lengths' noise."""
_ESTIMATORS = ("practice", "ls", "gm", "ml")


@dataclass(frozen=True)
class OnePass:
    """Periodic motion at a speed that rises from zero and returns to it."""

    motion: Any
    passes: float
    ramp: float

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return self.passes * self.motion.period + self.ramp

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return pose, rate and acceleration, (T, 6) each."""
        rising, falling = (self._rise(t) for t in (times, self.duration - times))
        end = self.passes * self.motion.period
        phase = np.where(times < self.duration / 2, rising[0], end - falling[0])
        speed = rising[1] * falling[1]
        change = rising[2] - falling[2]
        pose, rate, acceleration = self.motion.at(phase)
        faster = acceleration * speed[:, None] ** 2 + rate * change[:, None]
        return pose, rate * speed[:, None], faster

    def _rise(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time along the motion, its rate and the rate's change, (T,)."""
        x = np.clip(times / self.ramp, 0, 1)
        along = self.ramp * (2.5 * x**4 - 3 * x**5 + x**6) + np.maximum(times - self.ramp, 0)
        rate = 10 * x**3 - 15 * x**4 + 6 * x**5
        return along, rate, 30 * x**2 * (1 - x) ** 2 / self.ramp


def record(robot: str, number: int, memory: float, lengths: float) -> tuple[Any, Measurement]:
    """Return a machine and its recording."""
    machine = unknowns.draw_truth(unknowns.read_machine(robot), np.random.default_rng([1, number]))
    motion = OnePass(unknowns.read_motion(robot), _PASSES, _RAMP)
    times = np.arange(int(motion.duration * _RATE)) / _RATE
    rng = np.random.default_rng([2, number])
    exact = simulate(machine, motion, times, {}, sensors=None, rng=rng)
    of_forces, of_lengths = read_noise(unknowns.ROBOTS[robot])
    less = _RATE / 1000
    noise = (
        draw_noise(len(times), lengths**2 * less * of_lengths, rng),
        draw_noise(len(times), less * of_forces, rng, memory),
    )
    return machine, Measurement(times, *map(np.add, exact, noise))


@dataclass(frozen=True)
class Outcome:
    """Errors, standard deviations and half widths of the 95 % intervals, (m,), by estimator."""

    errors: dict[str, list[float]]
    std: dict[str, list[float]]
    widths: dict[str, list[float]]


def outcome(robot: str, number: int, memory: float, lengths: float) -> Outcome:
    """Return the estimates of one recording."""
    machine, data = record(robot, number, memory, lengths)
    path = str(unknowns.ROBOTS[robot])
    found = Outcome({}, {}, {})
    highest = unknowns.read_design(robot).harmonics / unknowns.read_motion(robot).period
    for settings, wanted in (
        ({"differentiation": "spline"}, ("ls", "gm", "ml")),
        ({"differentiation": "butterworth", "cutoff": 3 * highest, "noise": "given"}, ("ls",)),
    ):
        options = settings | {"systematic": "none", "estimators": ["ls"]}
        config = load_run({"name": "shots", "robot": path, "estimate": options})
        own = robot_from(config.robot)
        priors = ParameterPriors.of(own, config.run.estimate)
        practice = settings["differentiation"] == "butterworth"
        with threadpool_limits(limits=1, user_api="blas"):
            try:
                experiment = prepare_experiment(config, own, data, None)
            except MotionFitError:
                if practice:  # No pose has the noisy lengths of some sample.
                    continue
                raise
            estimates = run_estimators(own, [experiment], priors, wanted)
        truth = np.array([machine.parameters[name] for name in priors.names])
        for name, each in estimates.items():
            key = "practice" if practice else name
            std = _std_of_white_residuals(experiment, each.values) if practice else each.std
            freedom = np.full(len(std), np.inf) if practice else each.freedom
            found.errors[key] = (each.values - truth).tolist()
            found.std[key] = std.tolist()
            found.widths[key] = (interval_widths(freedom) * std).tolist()
    return found


def _std_of_white_residuals(experiment: Any, values: np.ndarray) -> np.ndarray:
    columns = experiment.fitted_regressors.reshape(-1, len(values))
    rest = experiment.forces.ravel() - columns @ values
    variance = rest @ rest / (len(rest) - len(values))
    return np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns)))


def rows(section: str, repetitions: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield a row per noise and estimator for a machine."""
    for case, (memory, lengths) in _CASES.items():
        keys = [[section, k, memory, lengths] for k in range(repetitions or DRAWS)]
        found = [Outcome(**keep("shots", key, outcome, *key)) for key in keys]
        for name in _ESTIMATORS:
            known = [each for each in found if name in each.errors]
            if not known:
                continue
            errors = np.array([each.errors[name] for each in known])
            std = np.array([each.std[name] for each in known])
            covered = np.abs(errors) < [each.widths[name] for each in known]
            of_recordings = covered.mean(axis=1)
            rms = np.sqrt(np.mean(errors**2, axis=0))
            yield {
                "noise": case,
                "estimator": name,
                "recordings": len(known),
                "cover (%)": round(100 * float(covered.mean()), 1),
                "±": round(100 * float(np.std(of_recordings) / np.sqrt(len(known))), 1),
                "std (mean)": float(f"{np.exp(np.mean(np.log(std))):.3g}"),
                "rms error (mean)": float(f"{np.exp(np.mean(np.log(rms))):.3g}"),
                "bias / rms": round(float(np.mean(np.abs(errors.mean(axis=0)) / rms)), 2),
            }


def summary(table: pd.DataFrame) -> str:
    """Return the coverage of ML, and the errors of common practice over those of ML."""
    errors = table.pivot(index="noise", columns="estimator", values="rms error (mean)")
    cover = table[table["estimator"] == "ml"]["cover (%)"]
    ratio = errors["practice"] / errors["ml"]
    return (
        f"ML covers {cover.min()} to {cover.max()} %; common practice has {ratio.min():.2g} to "
        f"{ratio.max():.2g} times its errors (geometric means over the parameters)"
    )
