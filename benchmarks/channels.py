"""Recordings with wrong channels, one fault or two at once, and the section `data` that is printed.

Every draw has other parameters, 50 to 150 % of the nominal ones, other noise and other struts. The
file is read again with the section that was printed: right are lengths, forces and delay of the
machine. Machines: PaLiDA, an irregular one, MathWorks; five periods of 250 samples, with as much
less noise as at 1 kHz. Sections named `shot` read the same motions, from rest to rest, as motions
without a period, every other one with forces whose noise has a memory of ten samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy import signal

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.data.reading import measurement_of
from estimation.data.table import RawTable
from estimation.identification.periods import leave_out_ramps, window_keys
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
_DELAY_ERROR = 0.5
"""Steps."""
_MEMORY = 0.9
"""Correlation of the forces' noise from sample to sample."""
_WINDOW_ERROR = 0.03
"""Relative to the period."""

Row = dict[str, Any]


@dataclass
class Recorded:
    """A simulated recording: readings of the lengths from home, m, and forces, N."""

    rng: np.random.Generator
    simulate: Callable[[float, NDArray[np.intp]], tuple[Array, Array]]
    """Delay, s, and steps of rest, lead-in, lead-out and rest → readings and forces, (T, 6)."""
    home: Array
    step: float
    delay: float = 0.0
    leads: NDArray[np.intp] = field(default_factory=lambda: np.zeros(4, dtype=np.intp))
    readings: Array = field(init=False)
    forces: Array = field(init=False)
    kept: NDArray[np.intp] = field(init=False)
    """Numbers of the rows that are not lost."""

    def __post_init__(self) -> None:
        """Simulate the recording with its delay, lead-in and lead-out."""
        self.readings, self.forces = self.simulate(self.delay, self.leads)
        self.kept = np.arange(len(self.forces))


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
    recorded.__post_init__()


def _ramps(recorded: Recorded) -> None:
    """Add rests up to a period, lead-in and lead-out of a third to one period."""
    shares = recorded.rng.uniform([0, 1 / 3, 1 / 3, 0], 1)
    recorded.leads = np.rint(shares * _SAMPLES).astype(np.intp)
    recorded.__post_init__()


def _lost_rows(recorded: Recorded) -> None:
    """Lose one to three rows at ten places."""
    first = recorded.rng.choice(len(recorded.forces) - 4, 10, replace=False) + 1
    lost = np.concatenate([np.arange(one, one + recorded.rng.integers(1, 4)) for one in first])
    recorded.kept = np.delete(recorded.kept, lost)


_OF_MOTION = ("delay", "ramps", "lost rows")
_FAULTS: dict[str, Callable[[Recorded], None]] = {
    "delay": _delay,
    "ramps": _ramps,
    "lost rows": _lost_rows,
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
    faults, wanted = SECTIONS[section]
    shot = "shot" in section
    options = {"with_design": not shot and "design" not in section, "shot": shot}
    for machine in _ROBOTS:
        for names in faults:
            draws = Parallel(n_jobs=2)(
                delayed(_draw)(machine, names, seed, **options)
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
    right, doubtful = (float(shares.get(one, 0.0)) for one in ("right", "right, not certain"))
    wrong = float(shares.get("wrong as certain", 0.0))
    holds = wrong == 0 and right + doubtful >= (_LEAST_RIGHT if names else _LEAST_SILENT)
    return {
        "machine": machine,
        "faults": " and ".join(names) or "none",
        "right (%)": f"{100 * right:.3g}",
        "right, not certain (%)": f"{100 * doubtful:.3g}",
        "nothing, or another not certain (%)": f"{100 * shares.get('silent', 0.0):.3g}",
        "wrong as certain (%)": f"{100 * wrong:.3g}",
        "holds": "yes" if holds else "no",
    }


def _draw(
    machine: str, names: tuple[str, ...], seed: int, *, with_design: bool, shot: bool = False
) -> str:
    """Return the outcome of one draw: right, certain or not, silent, or wrong as certain."""
    run = load_run({"name": "channels", "robot": _ROBOTS[machine], "data": {"offset": "home"}})
    robot = robot_from(run.robot)
    design = TrajectoryFile.read(_ROOT / "benchmarks" / "designs" / f"{machine}.json").trajectory
    memory = _MEMORY * (seed % 2) if shot else 0.0
    recorded = _record(robot, design, np.random.default_rng([seed, len(names)]), memory)
    if shot:
        _ramps(recorded)
    for name in filter(names.__contains__, _OF_MOTION):
        _FAULTS[name](recorded)
    true_readings, true_forces = recorded.readings, recorded.forces
    for name in names:
        if name not in _OF_MOTION:
            _FAULTS[name](recorded)
    section = run.run.data

    def read(section: DataSection) -> Measurement:
        values = {
            "t": recorded.kept * recorded.step,
            **dict(zip(LENGTH_CHANNELS, recorded.readings[recorded.kept].T, strict=True)),
            **dict(zip(FORCE_CHANNELS, recorded.forces[recorded.kept].T, strict=True)),
        }
        return measurement_of(RawTable(Path(machine), values, {}), section, robot, plausible=False)

    planned = design if with_design else None
    known = run.with_section("trajectory", frequency=(design.omega / 2 / np.pi,) * 2)
    known = known.with_section("trajectory", harmonics=design.harmonics)
    whole = data = read(section)
    if shot:
        known = known.with_section("estimate", differentiation="spline")
    else:
        data = leave_out_ramps(known, whole, planned)
    found = check_recording(known, robot, fold_measurement(known, data, planned), planned)
    if data is not whole:
        found = replace(found, keys=window_keys(data) | found.keys)
    of_channels = set(names) - {"lost rows", "ramps"}
    # A lag that may be a delay, a filter or both is not in the section, but stated as not certain.
    certain = not found.lag and (found.sure or not found.faults)
    if not (found.faults if of_channels else certain):
        return "silent"
    corrected = load_run(
        {"name": "channels", "robot": _ROBOTS[machine], "data": found.corrected(section)}
    ).run.data
    again = read(corrected)
    rows = np.rint(again.time / recorded.step).astype(int)
    ends = np.array([rows[0], rows[-1] + 1]) - np.cumsum(recorded.leads)[[1, 1]]
    shift = ends - [0, _SAMPLES * _PERIODS]
    early, late = -shift, shift - recorded.delay / recorded.step  # late forces repeat later
    errors = {
        _LENGTH_ERROR: (again.lengths - true_readings[rows] - recorded.home) / recorded.home,
        _FORCE_ERROR: (again.forces - true_forces[rows]) / np.max(np.abs(true_forces)),
        _DELAY_ERROR: (again.force_delay - recorded.delay) / recorded.step,
        _WINDOW_ERROR: 0.0 if shot else np.maximum(np.maximum(early, late), 0) / _SAMPLES,
    }
    right = all(np.max(np.abs(each)) < most for most, each in errors.items())
    if certain:
        return "right" if right else "wrong as certain"
    return "right, not certain" if right else "silent"


def _record(
    robot: Robot, design: FourierTrajectory, rng: np.random.Generator, memory: float
) -> Recorded:
    """Simulate a recording of a machine with other parameters."""
    spread = rng.uniform(1 - _SPREAD, 1 + _SPREAD, len(robot.parameters))
    parameters = robot.parameters * spread
    step = design.period / _SAMPLES
    less = _SAMPLES / (_AT_1_KHZ * design.period)
    noise = robot.description.noise
    if noise is None or noise.length_covariance is None or noise.force_covariance is None:
        raise ValueError(f"{robot.name} states no noise")
    length_noise, force_noise = (
        rng.normal(size=((_PERIODS + 4) * _SAMPLES, ACTUATORS)) @ np.linalg.cholesky(less * each).T
        for each in (noise.length_covariance, noise.force_covariance)
    )
    innovations = np.sqrt(1 - memory**2) * force_noise
    force_noise = signal.lfilter([1.0], [1.0, -memory], innovations, axis=0)
    home = robot.inverse_kinematics(robot.home)

    def simulate(delay: float, leads: NDArray[np.intp]) -> tuple[Array, Array]:
        rows = np.arange(_PERIODS * _SAMPLES + np.sum(leads))
        times, durations = np.float64(step) * rows, np.float64(step) * leads
        state = _motion(robot, design, times - delay, durations)
        late = _motion(robot, design, times, durations)
        forces = robot.actuator_forces(*state, parameters)
        readings = robot.inverse_kinematics(late[0]) - home
        return readings + length_noise[rows], np.asarray(forces + force_noise[rows])

    return Recorded(rng, simulate, home, step)


def _motion(
    robot: Robot, design: FourierTrajectory, times: Array, leads: Array
) -> tuple[Array, Array, Array]:
    """Return pose, rate and acceleration, faded in and out by polynomials of fifth degree."""
    periods = design.sample(times - leads[0] - leads[1])
    away = periods.pose - robot.home
    if not np.any(leads):
        return periods.pose, periods.rate, periods.acceleration
    fade = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    end = leads[0] + leads[1] + _PERIODS * design.period
    into, out = (times - leads[0]) / leads[1], (end + leads[2] - times) / leads[2]
    (s, ds, dds), (r, dr, ddr) = (
        [fade.deriv(k)(np.clip(share, 0, 1)) * rate**k for k in range(3)]
        for share, rate in ((into, 1 / leads[1]), (out, -1 / leads[2]))
    )
    size, change, bend = (
        each[:, None] for each in (s * r, ds * r + s * dr, dds * r + 2 * ds * dr + s * ddr)
    )
    pose = robot.home + size * away
    rate = size * periods.rate + change * away
    return pose, rate, size * periods.acceleration + 2 * change * periods.rate + bend * away


_SINGLE = tuple((name,) for name in _FAULTS)
_PAIRS = tuple(combinations(_FAULTS, 2))
SECTIONS: dict[str, tuple[tuple[tuple[str, ...], ...], int]] = {
    "single": (_SINGLE, 20),
    "pairs": (_PAIRS, 20),
    "clean": (((),), 200),
    "no-design": (_SINGLE, 20),
    "no-design-pairs": (_PAIRS, 20),
    "no-design-clean": (((),), 200),
    "shot": (tuple(one for one in _SINGLE if one != ("ramps",)), 20),
    "shot-clean": (((),), 200),
}
"""Faults and draws of each section."""
