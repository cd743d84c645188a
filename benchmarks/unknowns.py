"""Effects that the model lacks, in recordings of an independent simulator.

The machine of every recording is `tests/unknowns/simulator.py`, which shares no code with the
package. Its parameters differ from those of the robot file by some 5 %, and it has at most one
effect that the model lacks; the user of the package knows of neither. Periods of fewer samples than
at 1 kHz have as much less noise. Results of a commit are kept in ``build/unknowns``, so that a
measurement continues where it ended. ``python -m benchmarks.unknowns --help`` lists the options for
a part of the table.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from benchmarks.kept import keep
from estimation.data.measurement import Measurement
from estimation.diagnostics.attribution import MOST_ALTERNATIVES, Effect
from estimation.identification.estimate import estimate
from estimation.identification.estimation import estimate_parameters
from estimation.identification.result import EstimationResult
from expdesign.configuration import RunConfiguration, load_run
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from tests.unknowns.simulator import (
    Machine,
    Motion,
    NoPoseError,
    changed_parameters,
    deviate,
    draw_noise,
    follow_lengths,
    read_noise,
    simulate,
)

TITLE = "Effects that the model lacks"

_ROOT = Path(__file__).resolve().parents[1]
ROBOTS = {
    "palida": _ROOT / "expdesign" / "library" / "robots" / "palida.yaml",
    "irregular": _ROOT / "tests" / "unknowns" / "irregular.yaml",
    "mathworks": _ROOT / "expdesign" / "library" / "robots" / "mathworks.yaml",
}
"""Each has a design of its name."""
_AT_1_KHZ = 1e-3
_OFF = {"p2": 0.97, "p3": 0.98, "p5": 0.99, "p6": 1.06, "p7": 1.04, "p8": 1.05}
"""Parameters of the machines over those of the robot files; all bodies are possible ones."""
_SPREAD = 0.05
"""Relative spread of all rigid-body parameters together, and of each of friction."""
_OPEN_WORDS = "not in the list"

Row = dict[str, Any]


@dataclass(frozen=True)
class Recording:
    """Circumstances of a recording."""

    robot: str = "palida"
    design: str = "palida"
    periods: int = 10
    samples: float = 300
    """Of a period."""
    forces: float = 1.0
    lengths: float = 1.0
    """Factors of the standard deviations of the noise."""
    memory: float = 0.0
    """Correlation of the forces' noise from sample to sample."""
    tracking: float = 0.0
    """Error of the position in the harmonics 6 to 30, m."""


@dataclass(frozen=True)
class Case:
    """An effect, and what the package may say of it."""

    unit: str
    scale: float
    """From SI to the unit."""
    sizes: tuple[float, ...]
    """About detection, and larger ones from the fourth on, in the unit."""
    kinds: frozenset[str]
    """Effects of the diagnosis that are the right kind; others are wrong."""


def _case(unit: str, scale: float, sizes: Sequence[float], *kinds: str) -> Case:
    return Case(unit, scale, tuple(sizes), frozenset(kinds))


CASES = {
    "drive_inertia": _case("g", 1e3, (15, 25, 40, 100), "drive_inertia"),
    "quadratic_friction": _case(
        "% of viscous", 100, (2.5, 5, 7, 20), "quadratic_friction", "cubic_friction"
    ),
    "power_law": _case(
        "exponent", 1, (0.97, 0.95, 0.92, 0.7), "quadratic_friction", "cubic_friction"
    ),
    "viscous_joints": _case("N m s", 1, (0.03, 0.05, 0.08, 0.4), "passive_viscous_friction"),
    "saturation": _case("% at 200 N", 100, (0.5, 0.8, 1.2, 4), "force_saturation"),
    "slow_stribeck": _case("% of dry", 100, (7, 14, 28), "stribeck"),
    "cable_drag": _case("N", 1, (0.3, 0.6, 0.9, 2.4), "platform_drag", "platform_spring"),
    "base_on_springs": _case("Hz", 1, (15, 11, 8)),
    "products_of_inertia": _case("g m^2", 1e3, (0.2, 0.3, 0.4, 8), "general_platform"),
    "low_pass": _case("ms", 1e3, (0.25, 0.35, 0.5), "delay", "lag", "low_pass"),
    "position_friction": _case("%", 100, (10, 15, 20, 40), "position_friction"),
    "direction_friction": _case("%", 100, (1, 2, 4), "asymmetric_friction", "force_offset"),
    "liquid": _case("kg", 1, (0.02, 0.04, 0.06, 0.2)),
    "length_delays": _case("ms", 1e3, (0.03, 0.045, 0.06, 0.15), "delay", "lag"),
    "ball_friction": _case("N m", 1, (0.02, 0.04, 0.06, 0.4), "passive_viscous_friction"),
    "speed_ripple": _case("N s/m", 1, (0.5, 1, 1.5, 4), "position-periodic"),
    "presliding": _case("mm", 1e3, (0.5, 1, 2, 5)),
    "clock_jitter": _case("ms", 1e3, (0.3, 1, 2)),
    "force_offset": _case("N", 1, (0.5, 0.9, 2), "force_offset"),
    "off_centre": _case("mm", 1e3, (0.1, 0.3, 2), "general_platform"),
}
"""Effects of the simulator."""

CLEAN = {
    "palida": Recording(),
    "3 harmonics": Recording(design="palida_best_3"),
    "8 harmonics": Recording(design="palida_best_8"),
    "2 periods": Recording(periods=2),
    "3 periods": Recording(periods=3),
    "no whole number of samples": Recording(samples=300.37),
    "tracking error of 50 um": Recording(tracking=5e-5),
    "1 mm length noise": Recording(lengths=10),
    "AR(1), 0.9": Recording(memory=0.9),
    "AR(1), 0.99": Recording(memory=0.99),
    "1 mm length noise, tenth of the force noise": Recording(lengths=10, forces=0.1),
    "irregular": Recording("irregular", "irregular"),
    "irregular, tenth of the force noise": Recording("irregular", "irregular", forces=0.1),
    "irregular, tenth of the force noise, 8 periods": Recording(
        "irregular", "irregular", 8, forces=0.1
    ),
    "irregular, slow": Recording("irregular", "irregular_slow", 8),
}
"""Recordings without an effect."""


@dataclass(frozen=True)
class Outcome:
    """Estimate and verdict of one recording."""

    accepted: bool
    summary: str
    effects: list[tuple[str, int | None, str, bool]]
    """Kind, strut, parameter, and whether it is certain, of all effects, the first one first."""
    alternatives: list[str]
    """Kinds that the data do not distinguish from the first effect."""
    errors: dict[str, float]
    """Estimate less truth in half widths of the 95 % interval."""
    undetected: dict[str, float]
    """`std_undetected` over `std`."""
    seconds: float

    def covered(self, rigid: bool, widened: bool = False) -> list[bool]:
        """Return for rigid-body or friction parameters whether the interval holds the truth."""
        return [
            abs(error) <= (np.hypot(1, self.undetected.get(name, 0.0)) if widened else 1)
            for name, error in self.errors.items()
            if _is_rigid(name) == rigid
        ]

    def named_right(self, kinds: frozenset[str]) -> bool:
        """Return whether the first effect is of the right kind."""
        return bool(self.effects) and self.effects[0][0] in kinds

    def named_among(self, kinds: frozenset[str]) -> bool:
        """Return whether it is the first effect, or one of few alternatives that are named."""
        few = len(self.alternatives) <= MOST_ALTERNATIVES
        return self.named_right(kinds) or (few and not kinds.isdisjoint(self.alternatives))

    def named_nothing(self) -> bool:
        """Return whether the recording is doubted without a cause, or for one that is unknown."""
        return not self.accepted and (not self.effects or _OPEN_WORDS in self.summary)

    def wrong_and_sure(self, kinds: frozenset[str]) -> bool:
        """Return whether an effect of another kind is certain."""
        return any(sure and kind not in kinds for kind, _, _, sure in self.effects)


def _is_rigid(name: str) -> bool:
    return name[0] in "psI"


def measure(
    recording: Recording, effect: str, size: float, numbers: Iterable[int]
) -> list[Outcome]:
    """Return the outcomes of recordings with an effect of a size, SI."""
    found = []
    for number in numbers:
        key = [asdict(recording), effect, size, number]
        kept = keep("unknowns", key, outcome_of, recording, effect, size, number)
        found.append(Outcome(**kept))
    return found


def outcome_of(recording: Recording, effect: str, size: float, number: int) -> Outcome:
    """Return the outcome of a recording with an effect of a size, SI."""
    truth = draw_truth(read_machine(recording.robot), np.random.default_rng([1, number]))
    effects = {effect: size} if effect else {}
    data = _record(recording, truth, effects, np.random.default_rng([2, number]))
    began = time.process_time()
    result = estimate(run_of(recording), data, read_design(recording.design))
    return _judge(result, changed_parameters(truth, effects), time.process_time() - began)


def _judge(result: EstimationResult, truth: Mapping[str, float], seconds: float) -> Outcome:
    if result.diagnostics is None:
        raise RuntimeError("the estimate was not diagnosed")
    verdict = result.diagnostics.verdict
    rows = [row for row in result.rows if row.estimator == result.best]
    (tests,) = result.diagnostics.experiments
    drifts: list[tuple[str, int | None, str, bool]] = [
        ("gain_drift", each.actuator, "", True) for each in tests.gain_drift.found
    ]
    return Outcome(
        accepted=verdict.status == "accepted",
        summary=verdict.summary,
        alternatives=_alternatives(tests.effects),
        effects=drifts + [(e.kind, e.strut, e.parameter, e.certain) for e in tests.effects],
        errors={
            row.parameter: 2 * (row.value - truth[row.parameter]) / (row.ci_high - row.ci_low)
            for row in rows
        },
        undetected={row.parameter: row.std_undetected / row.std for row in rows},
        seconds=seconds,
    )


def _alternatives(effects: Sequence[Effect]) -> list[str]:
    if not effects:
        return []
    kinds = dict.fromkeys(rival.kind for rival in effects[0].rivals)
    return [kind for kind in kinds if kind != effects[0].kind]


# --- recordings -----------------------------------------------------------------------------------


@cache
def read_machine(robot: str) -> Any:
    """Return a machine of the simulator, as its robot file states it."""
    return Machine.read(ROBOTS[robot])


def draw_truth(machine: Any, rng: np.random.Generator) -> Any:
    """Return a machine with other parameters."""
    together, *each = 1 + _SPREAD * rng.standard_normal(1 + len(machine.parameters))
    drawn = {
        name: value * _OFF.get(name, 1.0) * (together if _is_rigid(name) else one)
        for (name, value), one in zip(machine.parameters.items(), each, strict=True)
    }
    return replace(machine, parameters=drawn)


@cache
def read_design(name: str) -> FourierTrajectory:
    """Return the trajectory of a design."""
    return TrajectoryFile.read(_ROOT / "benchmarks" / "designs" / f"{name}.json").trajectory


@cache
def read_motion(name: str) -> Any:
    """Return the motion of a design for the simulator."""
    path = _ROOT / "benchmarks" / "designs" / f"{name}.json"
    return Motion.read(json.loads(path.read_text()))


@cache
def run_of(recording: Recording, systematic: str = "", draw: str = "") -> RunConfiguration:
    """Return the run of a user who knows of no effect, or of tolerances."""
    sampling = recording.samples / read_motion(recording.design).period
    options = {"systematic": systematic} if systematic else {}
    return load_run(
        {
            "name": "unknowns",
            "robot": str(ROBOTS[recording.robot]),
            "experiment": {"periods": recording.periods, "sampling": sampling},
            "estimate": {"estimators": ["gm", "ml"], **options},
        }
        | ({"tolerances": _tolerances(recording.robot, draw)} if draw else {})
    )


def _record(
    recording: Recording,
    machine: Any,
    effects: Mapping[str, Any],
    rng: np.random.Generator,
    sensors: Any = None,
    drawn: Any = None,
) -> Measurement:
    """Record a machine; its controller follows the lengths of the drawn one, if there is one."""
    motion = read_motion(recording.design)
    if drawn is not None:
        motion = follow_lengths(machine, drawn, motion, sensors.zeros)
    if recording.tracking:
        motion = motion.with_tracking_error(recording.tracking, (6, 30), rng)
    step = motion.period / recording.samples
    stamps = step * np.arange(int(recording.periods * recording.samples))
    # Of periods that are alike, one is enough.
    alike = recording.samples == int(recording.samples) and "clock_jitter" not in effects
    times = stamps[: int(recording.samples)] if alike else stamps
    lengths, forces = (
        np.tile(part, (len(stamps) // len(times), 1))
        for part in simulate(machine, motion, times, effects, sensors=sensors, rng=rng)
    )
    less = _AT_1_KHZ / step
    of_forces, of_lengths = read_noise(ROBOTS[recording.robot])
    forces += draw_noise(len(stamps), less * recording.forces**2 * of_forces, rng, recording.memory)
    lengths += draw_noise(len(stamps), less * recording.lengths**2 * of_lengths, rng)
    return Measurement(stamps, lengths, forces)


# --- tolerances -----------------------------------------------------------------------------------

_GEOMETRY = ("base_joints", "platform_joints", "strut_length")
_TOLERANCES: dict[str, Any] = {
    **dict.fromkeys(_GEOMETRY, 1e-4),
    "force_constant": {"common": 0.005, "each": 0.005},
    "gravity": float(np.deg2rad(0.1)),
    "delay": 2e-4,
}
"""Of `palida` and `irregular`, SI."""
_SIZE = {"mathworks": 5.0}
"""Geometry over that of `palida`."""
_TERMS = {
    "drive_inertia": 0.03,
    "force_offset": 1.0,
    "load_friction": 0.01,
    "quadratic_friction": 1.0,
    "asymmetric_friction": 0.5,
    "passive_viscous_friction": 0.05,
}
"""Tolerances of terms that `palida` and `irregular` lack, SI."""
_WITH_TERMS = "with terms"
_DRAWS = ("small", "four times", _WITH_TERMS)


def _tolerances(robot: str, draw: str) -> dict[str, Any]:
    """Return the tolerances of a robot, in SI units."""

    def scaled(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: scaled(name, one) for name, one in value.items()}
        factor = _SIZE.get(robot, 1.0) if key in _GEOMETRY else 1.0
        return (4 if draw == "four times" else 1) * factor * value

    terms = {"terms": _TERMS} if draw == _WITH_TERMS else {}
    return {key: scaled(key, value) for key, value in _TOLERANCES.items()} | terms


@dataclass(frozen=True)
class Drawn:
    """Estimates of a machine that was drawn from its tolerances."""

    errors: dict[str, dict[str, float]]
    """Estimate less truth over the truth, by estimator and parameter."""
    covered: dict[str, dict[str, bool]]
    """Whether the 95 % interval holds the truth."""
    seconds: float
    """Processor time of GM and ML."""


def record_drawn(recording: Recording, draw: str, number: int) -> tuple[Any, Measurement]:
    """Return a machine as described, and the recording of one that is drawn from its tolerances.

    A machine that cannot follow the lengths is drawn again.
    """
    truth = draw_truth(read_machine(recording.robot), np.random.default_rng([1, number]))
    rng = np.random.default_rng([2, number])
    while True:
        machine, sensors, effects = deviate(truth, _tolerances(recording.robot, draw), rng)
        with suppress(NoPoseError):
            return truth, _record(recording, machine, effects, rng, sensors, truth)


def _drawn(recording: Recording, draw: str, systematic: str, number: int) -> Drawn:
    truth, data = record_drawn(recording, draw, number)
    began = time.process_time()
    estimation = estimate_parameters(
        run_of(recording, systematic, draw), data, read_design(recording.design)
    )
    found = Drawn({}, {}, time.process_time() - began)
    for row in estimation.rows:
        value = truth.parameters[row.parameter]
        if value:
            errors = found.errors.setdefault(row.estimator, {})
            errors[row.parameter] = (row.value - value) / value
        covered = found.covered.setdefault(row.estimator, {})
        covered[row.parameter] = bool(row.ci_low <= value <= row.ci_high)
    return found


def tolerance_rows(
    recording: Recording, draws: Iterable[str], settings: Iterable[str], count: int
) -> Iterator[Row]:
    """Yield a row for each estimator and setting of `estimate.systematic`."""
    for draw, systematic in itertools.product(draws, settings):
        found = []
        for number in range(count):
            key = [asdict(recording), _tolerances(recording.robot, draw), systematic, number]
            kept = keep("unknowns", key, _drawn, recording, draw, systematic, number)
            found.append(Drawn(**kept))
        for estimator in found[0].errors:
            yield {
                "robot": recording.robot,
                "tolerances": draw,
                "estimator": f"{estimator}, {systematic}",
                "runs": count,
            } | _drawn_row(found, estimator)


def _drawn_row(found: Sequence[Drawn], estimator: str) -> Row:
    errors = np.array([list(each.errors[estimator].values()) for each in found])
    covered = [each.covered[estimator] for each in found]
    shares = np.array([list(each.values()) for each in covered])
    std_error = float(np.std(np.mean(shares, axis=1)) / np.sqrt(len(found)))
    rms = np.sqrt(np.mean(errors**2, axis=0))
    of_kind = (
        _percent(
            value for each in covered for name, value in each.items() if kind == _is_rigid(name)
        )
        for kind in (True, False)
    )
    return {
        "rms error": f"{100 * np.exp(np.mean(np.log(rms))):.2f} %",
        "covers": f"{100 * np.mean(shares):.1f} ± {100 * std_error:.1f} %",
        **dict(zip(("rigid", "friction"), of_kind, strict=True)),
        "seconds": f"{np.mean([each.seconds for each in found]):.2f}",
    }


# --- tables ---------------------------------------------------------------------------------------


def effect_rows(
    recording: Recording, effects: Iterable[str], count: int, sizes: Sequence[float] = ()
) -> Iterator[Row]:
    """Yield a row for every size of every effect."""
    for name in effects:
        case = CASES[name]
        for size in sizes or case.sizes:
            outcomes = measure(recording, name, size / case.scale, range(count))
            yield {"effect": name, "size": f"{size:g} {case.unit}"} | _row(outcomes, case.kinds)


def clean_rows(count: int) -> Iterator[Row]:
    """Yield a row for every kind of recording without an effect."""
    for name, recording in CLEAN.items():
        outcomes = measure(recording, "", 0.0, range(count))
        yield {"effect": "none", "size": name} | _row(outcomes, frozenset())


def _row(outcomes: Sequence[Outcome], kinds: frozenset[str]) -> Row:
    accepted = [each for each in outcomes if each.accepted]
    firsts = Counter(_first_cause(each) for each in outcomes if not each.accepted)
    return {
        "runs": len(outcomes),
        "accepted": _percent(each.accepted for each in outcomes),
        "covers: rigid": _percent(x for each in accepted for x in each.covered(True)),
        "friction": _percent(x for each in accepted for x in each.covered(False)),
        "widened: rigid": _percent(x for each in accepted for x in each.covered(True, True)),
        "widened: friction": _percent(x for each in accepted for x in each.covered(False, True)),
        "median widening": _widening(accepted),
        "right kind first": _percent(each.named_right(kinds) for each in outcomes),
        "or an alternative": _percent(each.named_among(kinds) for each in outcomes),
        "not in the list": _percent(each.named_nothing() for each in outcomes),
        "wrong and sure": _percent(each.wrong_and_sure(kinds) for each in outcomes),
        "first causes": ", ".join(f"{name} {count}" for name, count in firsts.most_common(3)),
        "seconds": f"{np.mean([each.seconds for each in outcomes]):.2f}",
    }


def _widening(outcomes: Sequence[Outcome]) -> str:
    """Return the median factor of the half widths that `std_undetected` makes."""
    shares = [share for each in outcomes for share in each.undetected.values()]
    return f"{np.median(np.hypot(1, shares)):.2f}" if shares else ""


def _first_cause(outcome: Outcome) -> str:
    if not outcome.effects:
        return outcome.summary.removeprefix("doubtful: ").split(" (")[0].split(";")[0]
    kind, strut, parameter, sure = outcome.effects[0]
    return f"{kind}{'' if strut is None else ' of one'}{' ' * bool(parameter)}{parameter}" + (
        "" if sure else " (not sure)"
    )


def _percent(values: Iterable[bool]) -> str:
    found = list(values)
    return f"{100 * np.mean(found):.0f} %" if found else ""


_TABLES = {
    "palida-300": Recording(),
    "palida-1667": Recording(samples=1667),
    "irregular-300": Recording("irregular", "irregular"),
    "irregular-1667": Recording("irregular", "irregular", samples=1667),
}
SECTIONS = (*_TABLES, "clean", "tolerances")
_SETTINGS = ("auto", "budget")


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section."""
    with threadpool_limits(limits=1):
        if section == "clean":
            yield from clean_rows(repetitions or 47)
        elif section == "tolerances":
            for robot in ROBOTS:
                recording = Recording(robot, robot)
                draws = [draw for draw in _DRAWS if robot not in _SIZE or draw != _WITH_TERMS]
                yield from tolerance_rows(recording, draws, _SETTINGS, repetitions or 200)
        else:
            yield from effect_rows(_TABLES[section], CASES, repetitions or 20)


def summary(table: pd.DataFrame) -> str:
    """Return the number of recordings."""
    return f"{table['runs'].sum()} recordings."


def main() -> None:
    """Print a part of the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--effects", default=",".join(CASES), help="names, comma-separated")
    parser.add_argument("--sizes", default="", help="in the unit of the effect, comma-separated")
    parser.add_argument("--count", type=int, default=10, help="recordings of each size")
    parser.add_argument("--samples", type=float, default=300, help="of a period")
    parser.add_argument("--robot", choices=ROBOTS, default="palida")
    parser.add_argument("--clean", action="store_true", help="recordings without an effect")
    parser.add_argument("--tolerances", action="store_true", help="truths drawn from tolerances")
    parser.add_argument("--draws", default=",".join(_DRAWS), help="sizes of the tolerances")
    parser.add_argument(
        "--systematic", default=",".join(_SETTINGS), help="values of `estimate.systematic`"
    )
    options = parser.parse_args()
    recording = Recording(options.robot, options.robot, samples=options.samples)
    sizes = [float(size) for size in options.sizes.split(",") if size]
    if options.clean:
        found = clean_rows(options.count)
    elif options.tolerances:
        settings = options.systematic.split(",")
        found = tolerance_rows(recording, options.draws.split(","), settings, options.count)
    else:
        found = effect_rows(recording, options.effects.split(","), options.count, sizes)
    with threadpool_limits(limits=1):
        for k, row in enumerate(found):
            if not k:
                print("| " + " | ".join(row) + " |\n" + "|---" * len(row) + "|")
            print("| " + " | ".join(map(str, row.values())) + " |", flush=True)


if __name__ == "__main__":
    main()
