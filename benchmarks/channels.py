"""Recordings with wrong channels, one fault or two at once, and the section `data` that is printed.

Every draw has other parameters, 50 to 150 % of the nominal ones, other noise and other struts. The
file is read again with the section that was printed: right are lengths, forces and delay of the
machine. Machines: PaLiDA, an irregular one, MathWorks; five periods of 250 samples, with as much
less noise as at 1 kHz.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.data.reading import measurement_of
from estimation.data.table import RawTable
from estimation.identification.recording import check_recording, fold_measurement
from expdesign.configuration import load_run
from expdesign.configuration.estimate import FORCE_CHANNELS, LENGTH_CHANNELS, DataSection
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

TITLE = "Wrong channels"

_ROOT = Path(__file__).resolve().parents[1]
_ROBOTS = {
    "palida": "palida",
    "irregular": str(_ROOT / "tests" / "unknowns" / "irregular.yaml"),
    "mathworks": "mathworks",
}
_SAMPLES, _PERIODS, _AT_1_KHZ = 250, 5, 1e3
_SPREAD = 0.5
_LEAST_RIGHT, _LEAST_SILENT = 0.95, 0.99
_LENGTH_ERROR = 1e-3
"""Relative to the length."""
_FORCE_ERROR = 0.05

Row = dict[str, Any]


@dataclass
class Recorded:
    """A simulated recording: readings of the lengths from home, m, and forces, N."""

    rng: np.random.Generator
    readings: Array
    forces_at: Callable[[float], Array]
    home: Array
    step: float
    forces: Array = field(init=False)
    delay: float = 0.0

    def __post_init__(self) -> None:
        """Take the forces without a delay."""
        self.forces = self.forces_at(0.0)


def _pair(recorded: Recorded) -> NDArray[np.intp]:
    order = np.arange(ACTUATORS)
    i, j = recorded.rng.choice(ACTUATORS, 2, replace=False)
    order[[i, j]] = j, i
    return order


def _one(recorded: Recorded) -> Array:
    return np.eye(ACTUATORS)[recorded.rng.integers(ACTUATORS)]


def _force_sign(recorded: Recorded) -> None:
    recorded.forces = recorded.forces * (1 - 2 * _one(recorded))


def _length_sign(recorded: Recorded) -> None:
    recorded.readings = recorded.readings * (1 - 2 * _one(recorded))


def _forces_swapped(recorded: Recorded) -> None:
    recorded.forces = recorded.forces[:, _pair(recorded)]


def _lengths_swapped(recorded: Recorded) -> None:
    recorded.readings = recorded.readings[:, _pair(recorded)]


def _zero(recorded: Recorded) -> None:
    size = recorded.rng.choice([-1, 1]) * recorded.rng.uniform(0.005, 0.02)
    recorded.readings = recorded.readings + size * recorded.home * _one(recorded)


def _factor(recorded: Recorded) -> None:
    if recorded.rng.integers(2):
        recorded.forces = recorded.forces * (1 + _one(recorded))
    else:
        recorded.readings = recorded.readings * (1 + _one(recorded))


def _unit(recorded: Recorded) -> None:
    recorded.readings = 1e3 * recorded.readings


def _delay(recorded: Recorded) -> None:
    recorded.delay = recorded.rng.integers(1, 11) * recorded.step
    recorded.forces = recorded.forces_at(recorded.delay)


_FAULTS: dict[str, Callable[[Recorded], None]] = {
    "delay": _delay,  # before the others, which change the delayed forces
    "sign of a force": _force_sign,
    "sign of a length": _length_sign,
    "two forces swapped": _forces_swapped,
    "two lengths swapped": _lengths_swapped,
    "wrong zero": _zero,
    "factor 2": _factor,
    "unit": _unit,
}


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield a row per machine and faults of a section."""
    faults, with_design, wanted = SECTIONS[section]
    for machine in _ROBOTS:
        for names in faults:
            draws = Parallel(n_jobs=2)(
                delayed(_draw)(machine, names, seed, with_design=with_design)
                for seed in range(repetitions or wanted)
            )
            yield _row(machine, names, pd.Series(draws).value_counts(normalize=True))


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    held = int((table["holds"] == "yes").sum())
    wrong = table[table["holds"] == "no"]
    text = f"{held} of {len(table)} hold"
    return (
        text
        if not len(wrong)
        else f"{text}; not: "
        + "; ".join(
            f"{machine}, {faults}"
            for machine, faults in zip(wrong["machine"], wrong["faults"], strict=True)
        )
    )


def _row(machine: str, names: tuple[str, ...], shares: pd.Series) -> Row:
    right = float(shares.get("right", 0.0))
    wrong = float(shares.get("wrong as certain", 0.0))
    holds = wrong == 0 and right >= (_LEAST_RIGHT if names else _LEAST_SILENT)
    return {
        "machine": machine,
        "faults": " and ".join(names) or "none",
        "right (%)": f"{100 * right:.3g}",
        "not certain, or nothing said (%)": f"{100 * shares.get('silent', 0.0):.3g}",
        "wrong as certain (%)": f"{100 * wrong:.3g}",
        "holds": "yes" if holds else "no",
    }


def _draw(machine: str, names: tuple[str, ...], seed: int, *, with_design: bool) -> str:
    """Return the outcome of one draw: right, silent, or wrong as certain."""
    run = load_run({"name": "channels", "robot": _ROBOTS[machine], "data": {"offset": "home"}})
    robot = robot_from(run.robot)
    design = TrajectoryFile.read(_ROOT / "benchmarks" / "designs" / f"{machine}.json").trajectory
    recorded = _record(robot, design, np.random.default_rng([seed, len(names)]))
    true_readings, true_forces = recorded.readings, recorded.forces
    for name, fault in _FAULTS.items():
        if name == "delay" and name in names:
            fault(recorded)
            true_forces = recorded.forces
        elif name in names:
            fault(recorded)
    section = run.run.data

    def read(section: DataSection) -> Measurement:
        time = np.arange(len(recorded.forces)) * recorded.step
        values = {
            "t": time,
            **dict(zip(LENGTH_CHANNELS, recorded.readings.T, strict=True)),
            **dict(zip(FORCE_CHANNELS, recorded.forces.T, strict=True)),
        }
        return measurement_of(RawTable(Path(machine), values, {}), section, robot, plausible=False)

    planned = design if with_design else None
    known = run.with_section("trajectory", frequency=(design.omega / 2 / np.pi,) * 2)
    known = known.with_section("trajectory", harmonics=design.harmonics)
    folded = fold_measurement(known, read(section), planned)
    found = check_recording(known, robot, folded, planned)
    if not names:
        return "wrong as certain" if found.sure else "silent" if found.faults else "right"
    if not found.sure:
        return "silent"
    corrected = load_run(
        {"name": "channels", "robot": _ROBOTS[machine], "data": found.corrected(section)}
    ).run.data
    again = read(corrected)
    lengths = np.max(np.abs(again.lengths - true_readings - recorded.home) / recorded.home)
    forces = np.max(np.abs(again.forces - true_forces)) / np.max(np.abs(true_forces))
    late = abs(again.force_delay - recorded.delay) / recorded.step
    right = lengths < _LENGTH_ERROR and forces < _FORCE_ERROR and late < 0.5  # noqa: PLR2004
    return "right" if right else "wrong as certain"


def _record(robot: Robot, design: FourierTrajectory, rng: np.random.Generator) -> Recorded:
    """Simulate a recording of a machine with other parameters."""
    spread = rng.uniform(1 - _SPREAD, 1 + _SPREAD, len(robot.parameters))
    parameters = robot.parameters * spread
    step = design.period / _SAMPLES
    times = np.arange(_SAMPLES * _PERIODS) * step
    less = _SAMPLES / (_AT_1_KHZ * design.period)
    noise = robot.description.noise
    if noise is None or noise.length_covariance is None or noise.force_covariance is None:
        raise ValueError(f"{robot.name} states no noise")
    length_noise, force_noise = (
        rng.normal(size=(len(times), ACTUATORS)) @ np.linalg.cholesky(less * each).T
        for each in (noise.length_covariance, noise.force_covariance)
    )

    def forces_at(delay: float) -> Array:
        state = design.sample(times - delay)
        forces = robot.actuator_forces(state.pose, state.rate, state.acceleration, parameters)
        return np.asarray(forces + force_noise)

    home = robot.inverse_kinematics(robot.home)
    readings = robot.inverse_kinematics(design.sample(times).pose) - home + length_noise
    return Recorded(rng, readings, forces_at, home, step)


_SINGLE = tuple((name,) for name in _FAULTS)
SECTIONS: dict[str, tuple[tuple[tuple[str, ...], ...], bool, int]] = {
    "single": (_SINGLE, True, 20),
    "pairs": (tuple(combinations(_FAULTS, 2)), True, 20),
    "clean": (((),), True, 200),
    "no-design": (_SINGLE, False, 20),
    "no-design-clean": (((),), False, 200),
}
"""Faults of each section, whether the design is known, and the draws."""
