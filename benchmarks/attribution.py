"""Which cause diagnostics name when a machine has one that the model does not know.

PaLiDA on its stored design, 10 periods of 300 samples, Gauss–Markov. The recording is that of a
machine with one departure; `size` is what the departure is in its unit, and `power` the probability
with which its own test finds one of this size, by the information at the truth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal, stats
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import AttributedDiagnosis
from estimation.diagnostics.linearisation import Signature
from estimation.diagnostics.search import EffectTests
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import apply_deviations, deviations
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

PERIODS, SAMPLES = 10, 300

Name = tuple[str, int | None, str]
"""Kind, strut (from 0) and parameter of an effect."""
Recorded = tuple[Array, Array]
"""Lengths, m, and forces, N, of all samples, (T, 6) each."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A machine with one departure from the model."""

    name: str
    unit: str
    size: float
    """In SI."""
    scale: float
    """From SI to the unit."""
    measured: Callable[[float], Recorded]
    """Size → what the machine measures without noise."""
    right: frozenset[Name]
    """What may be named first, and for sure."""
    estimate: Mapping[str, Any] = field(default_factory=dict)
    """Further keys of the run's `estimate`."""


@cache
def design() -> FourierTrajectory:
    """Return the stored design."""
    return TrajectoryFile.read(Path(__file__).parent / "designs" / "palida.json").trajectory


@cache
def _robot_mapping() -> dict[str, Any]:
    description = load_robot_description("palida").description
    return dict(description.model_dump(mode="json", by_alias=True))


def configuration(
    estimate: Mapping[str, Any] | None = None, noise: Mapping[str, Any] | None = None
) -> RunConfiguration:
    """Return the run of a user who knows nothing of the departure."""
    own = {} if noise is None else {"noise": noise}
    return load_run(
        own
        | {
            "name": "attribution",
            "robot": "palida",
            "experiment": {"periods": PERIODS, "sampling": SAMPLES / design().period},
            "estimate": {"estimators": ["gm"], "harmonics": 5, **(estimate or {})},
        }
    )


@cache
def twin() -> Twin:
    """Return the machine without a departure."""
    return Twin.of(configuration(), design())


@cache
def _robot() -> Robot:
    return robot_from(configuration().robot)


def _of(robot: Robot, delay: float = 0.0) -> Recorded:
    """Return what a machine measures, its forces late by a delay, s."""
    times = twin().grid.times
    lengths = robot.inverse_kinematics(design().sample(times).pose)
    return lengths, robot.actuator_forces(*design().sample(times - delay))


def _machine(**changes: Any) -> Robot:
    """Return PaLiDA with other keys of its file."""
    return robot_from(load_run({"name": "machine", "robot": _robot_mapping() | changes}).robot)


def _with_term(term: Any, **parameters: float) -> Recorded:
    """Return what a machine with another term measures."""
    known = _robot_mapping()
    terms, values = [*known["terms"], term], known["parameters"] | parameters
    return _of(_machine(terms=terms, parameters=values))


def _deviating(values: Mapping[str, float]) -> Recorded:
    """Return what a machine measures whose geometry, or gravity, deviates."""
    chosen = [each for each in deviations(_robot()) if each.name in values]
    machine = apply_deviations(_robot(), chosen, np.array([values[each.name] for each in chosen]))
    lengths, forces = _of(machine)
    zeros = [values.get(f"strut_length_{j + 1}", 0.0) for j in range(6)]
    return lengths + np.array(zeros), forces


def _gain(change: float, *, drifting: bool = False) -> Recorded:
    lengths, forces = _of(_robot())
    time_ = np.linspace(-0.5, 0.5, PERIODS).repeat(SAMPLES) if drifting else np.ones(len(forces))
    factor = np.ones_like(forces)
    factor[:, 1] += change * time_
    return lengths, forces * factor


def _cogging(size: float) -> Recorded:
    lengths, forces = _of(_robot())
    wave = size * np.sin(2 * np.pi * lengths / 0.06 + 0.3)
    return lengths, forces + wave * np.array([0, 0, 1, 1, 0, 0])


def _one(kind: str, strut: int | None = None, parameter: str = "") -> frozenset[Name]:
    return frozenset({(kind, strut, parameter)})


_JOINT = np.array([0.6, 0.64, -0.48])
"""Direction in which a joint is elsewhere."""
_TILT = np.array([0.8, 0.6])


@cache
def cases() -> dict[str, Case]:
    """Return all departures, by name."""
    mass = float(_robot().description.parameters["p10"])
    middle = float(np.mean(twin().lengths[:, 3]))
    spring = {"cable": {"rest_length": middle - 0.05}}
    stribeck = {"stribeck": {"velocity": 0.05}}
    listed = (
        Case(
            "force offset, one strut", "N", 2.8, 1.0,
            lambda x: _with_term("force_offset", o3=x), _one("force_offset", 2),
        ),
        Case("gain, one strut", "%", 0.024, 100.0, _gain, _one("gain", 1)),
        Case(
            "gain that drifts, one strut", "%", 0.055, 100.0,
            lambda x: _gain(x, drifting=True), _one("gain_drift", 1) | _one("gain", 1),
        ),
        Case(
            "cable, one strut", "N/m", 22.0, 1.0,
            lambda x: _with_term(spring, k4=x), _one("cable", 3),
        ),
        Case(
            "cogging (60 mm), two struts", "N", 5.0, 1.0, _cogging,
            _one("position-periodic", 2) | _one("position-periodic", 3),
        ),
        Case(
            "Stribeck friction (0.05 m/s), all struts", "N", 7.0, 1.0,
            lambda x: _with_term(stribeck, **{f"s{j}": x for j in range(1, 7)}), _one("stribeck"),
        ),
        Case(
            "friction by load, all struts", "%", 0.015, 100.0,
            lambda x: _with_term("load_friction", **{f"mu{j}": x for j in range(1, 7)}),
            _one("load_friction"),
        ),
        Case("delay", "ms", 5e-4, 1e3, lambda x: _of(_robot(), x), _one("delay")),
        Case(
            "base joint elsewhere", "mm", 3.5e-4, 1e3,
            lambda x: _deviating(_joint("base_joint_2", x)), _one("joint", 1, "base"),
        ),
        Case(
            "platform joint elsewhere", "mm", 1e-4, 1e3,
            lambda x: _deviating(_joint("platform_joint_5", x)), _one("joint", 4, "platform"),
        ),
        Case(
            "zero of a length", "mm", 8e-5, 1e3,
            lambda x: _deviating({"strut_length_6": x}), _one("length_zero", 5),
        ),
        Case(
            "tilt of gravity", "deg", np.deg2rad(0.8), 180 / np.pi,
            lambda x: _deviating({f"gravity_{k + 1}": x * _TILT[k] for k in range(2)}),
            _one("gravity"),
        ),
        Case(
            "p10 fixed at a wrong value", "%", 0.03, 100.0,
            lambda x: _of(_heavier(mass * (1 + x))), _one("column", None, "p10"),
            {"fixed": {"p10": mass}},
        ),
    )  # fmt: skip
    return {case.name: case for case in listed}


def _joint(name: str, size: float) -> dict[str, float]:
    return {f"{name}_{axis}": size * part for axis, part in zip("xyz", _JOINT, strict=True)}


def _heavier(mass: float) -> Robot:
    return _machine(parameters=_robot_mapping()["parameters"] | {"p10": mass})


def diagnosed(
    recorded: Recorded, number: int, run: RunConfiguration, memory: float = 0.0
) -> AttributedDiagnosis:
    """Measure, estimate and diagnose.

    Parameters
    ----------
    number : int
        Of the draw of noise.
    memory : float
        Correlation of the forces' noise from sample to sample.
    """
    drawn: Measurement = twin().measurement(number)
    noise = drawn.forces - twin().forces
    gain = np.full(len(noise), np.sqrt(1 - memory**2))
    gain[0] = 1.0  # from its stationary distribution on
    noise = signal.lfilter([1.0], [1.0, -memory], noise * gain[:, None], axis=0)
    data = replace(
        drawn, lengths=drawn.lengths - twin().lengths + recorded[0], forces=noise + recorded[1]
    )
    robot = robot_from(run.robot)
    knowledge = parameter_priors(run, robot)
    experiment = prepare_experiment(run, robot, data, design())
    found = run_estimators(robot, [experiment], knowledge, ("gm",))["gm"]
    return diagnose(robot, [experiment], knowledge, found).recordings[0]


def named(diagnosis: AttributedDiagnosis) -> list[tuple[Name, bool]]:
    """Return what is named, first what is most certain, and whether for sure.

    A gain that drifts comes first: the periods' differences know of no model.
    """
    drifts = [
        (("gain_drift", each.actuator, ""), True) for each in diagnosis.tests.gain_drift.found
    ]
    effects = diagnosis.attribution.effects
    return drifts + [((e.kind, e.strut, e.parameter), e.certain) for e in effects]


def attribution(repetitions: int) -> Iterator[Row]:
    """Name the cause of every departure, each in as many draws of the noise."""
    with threadpool_limits(limits=1, user_api="blas"):
        for case in cases().values():
            yield _judged(case, repetitions)


def _judged(case: Case, repetitions: int) -> Row:
    run, recorded = configuration(case.estimate), case.measured(case.size)
    began = time.process_time()
    results = [named(diagnosed(recorded, k, run)) for k in range(1, repetitions + 1)]
    seconds = (time.process_time() - began) / repetitions
    first = sum(bool(found) and found[0][0] in case.right for found in results)
    alone = sum(bool(found) and found[0][0] in case.right and found[0][1] for found in results)
    wrong = sum(any(sure and name not in case.right for name, sure in found) for found in results)
    return {
        "departure": case.name,
        "size": f"{case.scale * case.size:.3g} {case.unit}",
        "power": f"{100 * power(case):.1f} %",
        "runs": repetitions,
        "right one first": f"{100 * first / repetitions:.0f} %",
        "and for sure": f"{100 * alone / repetitions:.0f} %",
        "a wrong one for sure": f"{100 * wrong / repetitions:.0f} %",
        "CPU time of a run": f"{seconds:.2f} s",
        "holds": "yes" if first >= 0.9 * repetitions and wrong <= 0.05 * repetitions else "no",
    }


def clean(repetitions: int) -> Iterator[Row]:
    """Name nothing where nothing departs, whatever the noise."""
    recorded = _of(_robot())
    halved = {"force_covariance": (0.5 * twin().truth.force_covariance).tolist()}
    for name, memory, run in (
        ("white noise", 0.0, configuration()),
        ("noise with memory, 0.5", 0.5, configuration()),
        ("noise with memory, 0.9", 0.9, configuration()),
        ("half of the noise's variance stated", 0.0, configuration({"noise": "given"}, halved)),
    ):
        with threadpool_limits(limits=1, user_api="blas"):
            results = [
                named(diagnosed(recorded, k, run, memory)) for k in range(1, repetitions + 1)
            ]
        nothing = sum(not found for found in results)
        yield {
            "departure": f"none, {name}",
            "runs": repetitions,
            "nothing named": f"{100 * nothing / repetitions:.1f} %",
            "holds": "yes" if nothing >= 0.95 * repetitions else "no",
        }


def power(case: Case) -> float:
    """Return the probability with which the test of a departure's own kind finds it."""
    if "gain_drift" in {kind for kind, _, _ in case.right}:
        return _power_of_drift(case)
    run, clean_run = configuration(case.estimate), twin()
    diagnosis = diagnosed((clean_run.lengths, clean_run.forces), 1, run)
    tests = diagnosis.attribution.first
    moved = [part - whole for part, whole in zip(
        case.measured(case.size), (clean_run.lengths, clean_run.forces), strict=True
    )]  # fmt: skip
    lengths, forces = (part.reshape(PERIODS, SAMPLES, 6).mean(axis=0) for part in moved)
    if case.right & _one("position-periodic", 2):
        forces[:, [0, 1, 3, 4, 5]] = 0.0  # one strut of the two
        return _exceeding(_noncentrality(tests, lengths, forces), 2, tests.scans[2].critical)
    kind = next(iter(case.right))[0]
    test = tests.families[kind]
    degrees = {"joint": 3, "gravity": 2, "cable": 2}.get(kind, 1)
    struts = {strut for _, strut, _ in case.right}
    own = [strut in struts for _, strut in test.hypothesis.labels]
    critical = float(stats.chi2.isf(np.exp(np.max(test.limits[own])), degrees))
    return _exceeding(_noncentrality(tests, lengths, forces), degrees, critical)


def _noncentrality(tests: EffectTests, lengths: Array, forces: Array) -> float:
    """Return what a departure adds to χ²: its information beyond parameters and motion."""
    signature = Signature(forces[:, :, None], lengths[:, :, None])
    return float(tests.solution.project(signature).information[0, 0])


def _exceeding(noncentrality: float, degrees: int, critical: float) -> float:
    return float(stats.ncx2.sf(critical, degrees, noncentrality))


def _power_of_drift(case: Case) -> float:
    test = diagnosed(case.measured(case.size), 1, configuration()).tests.gain_drift
    (std,) = {each.std for each in test.found if each.actuator == 1}
    critical = float(stats.norm.isf(test.level / 7 / 2))
    return float(stats.norm.cdf(case.size / std - critical))
