"""A payload of 5 kg on PaLiDA, which was identified without it: seconds, and honest intervals.

The run is `palida_payload` as it ships. Its design and one estimate of it are timed; then a machine
is identified with errors of its own, and measured with its payload, again and again. These
recordings have 250 samples in a period, with as much less noise: they tell as much as at 1 kHz.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

import expdesign
from benchmarks.studies import CLEAR_BIAS, ROOT, Row, claim_row, summary
from constraints.arrays import Array
from estimation.estimators import Experiment
from estimation.estimators.experiment import MotionEstimate
from estimation.estimators.joint_equations import PerturbedMachine, reduced_information
from estimation.estimators.prior_estimate import UnloadedMachine
from estimation.estimators.result import TEN, payload_estimate
from estimation.identification import estimate_parameters
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseEstimate, NoiseModel, PeriodSource, fold_recording
from estimation.twin import Twin
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import RunConfiguration, load_run
from expdesign.configuration.consistency import identification_of
from expdesign.experiment.setup import plan_search
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

__all__ = ["SECTIONS", "TITLE", "rows", "summary"]

TITLE = "A new payload"

_RUN = "palida_payload"
_SECONDS = 20.0
_SAMPLES = 250
_OFF = 0.05
"""Share by which standard deviations may be off their bound, beside the chance of so many runs."""
_CHANCE = 3.5
"""Standard errors of a Monte-Carlo figure that are no chance any more."""
_COVERS = (0.93, 0.97)


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` instead of what the claim is about."""
    measure, wanted = SECTIONS[section]
    return measure(repetitions or wanted)


def speed(_repetitions: int) -> Iterator[Row]:
    """Yield how long design and estimate take in one process, the machine code already there."""
    run = load_run({**load_run(_RUN).run.model_dump(by_alias=True), "workers": 1})
    plan_search(run).problem.compile()
    began, busy = time.perf_counter(), _processor_seconds()
    result = expdesign.design(run)
    designed, busy_designing = time.perf_counter(), _processor_seconds()
    recording = Twin.of(run, result.trajectory).measurement(1)
    measured, busy_measuring = time.perf_counter(), _processor_seconds()
    found = estimate_parameters(run, recording, result.trajectory)
    ended, busy_ended = time.perf_counter(), _processor_seconds()
    taken = [busy_designing - busy, busy_ended - busy_measuring]
    wall = [designed - began, ended - measured]
    for what, processor, passed in zip(("design", "estimate"), taken, wall, strict=True):
        yield claim_row(what, f"{processor:.1f} s of processor, {passed:.0f} s passed")
    yield claim_row(
        f"design and estimate: under {_SECONDS:g} s of processor",
        f"{sum(taken):.1f} s",
        sum(taken) < _SECONDS,
    )
    yield claim_row(
        "measuring time", f"{run.run.experiment.periods * result.trajectory.period:.1f} s"
    )
    yield claim_row("limits kept at every instant, proved", result.status, result.check.certified)
    payload = found.payloads["gm"]
    for name, value, std in zip(
        TEN, payload.vector, np.sqrt(np.diag(payload.covariance)), strict=True
    ):
        yield claim_row(f"one estimate: {name}", f"{value:.5g} ± {std:.2g}")


def _processor_seconds() -> float:
    return sum(resource.getrusage(resource.RUSAGE_SELF)[:2])


def montecarlo(repetitions: int) -> Iterator[Row]:
    """Yield spread, bias and coverage over identifications and recordings."""
    run, design = _equivalent_run(), _design()
    count = max(1, repetitions // 40)
    parts = Parallel(n_jobs=2)(
        delayed(_repeated)(run, design, range(first, min(first + count, repetitions + 1)))
        for first in range(1, repetitions + 1, count)
    )
    errors, std, widths = (np.concatenate(each) for each in zip(*parts, strict=True))
    bound = _joint_bound(run, design)
    stated = np.sqrt(np.diag(bound))
    spread, chance = np.std(errors, axis=0, ddof=1), 1 / np.sqrt(2 * (len(errors) - 1))
    for place, name in enumerate(TEN):
        ratio = float(spread[place] / stated[place])
        yield claim_row(
            f"{name}: spread / joint bound within 5 % and {_CHANCE:g} standard errors",
            f"{ratio:.3f} ± {ratio * chance:.3f} ({stated[place]:.3g})",
            abs(ratio - 1) <= _OFF + _CHANCE * chance,
        )
    white = np.linalg.solve(np.linalg.cholesky(bound), (errors - errors.mean(axis=0)).T)
    pooled = float(np.sqrt(np.sum(white**2) / (len(TEN) * (len(errors) - 1))))
    chance = 1 / np.sqrt(2 * len(TEN) * (len(errors) - 1))
    yield claim_row(
        f"all ten pooled: spread / joint bound within 5 % and {_CHANCE:g} standard errors",
        f"{pooled:.3f} ± {pooled * chance:.3f}",
        abs(pooled - 1) <= _OFF + _CHANCE * chance,
    )
    bias = errors.mean(axis=0) / (spread / np.sqrt(len(errors)))
    worst = int(np.argmax(np.abs(bias)))
    yield claim_row(
        f"bias of all ten within {CLEAR_BIAS:g} standard errors",
        f"{abs(bias[worst]):.2f} ({TEN[worst]})",
        bool(abs(bias[worst]) <= CLEAR_BIAS),
    )
    yield claim_row("stated std / joint bound, mean", f"{np.mean(std / stated):.3f}")
    covered = np.mean(np.abs(errors) <= widths * std, axis=1)
    share, error = float(np.mean(covered)), float(np.std(covered, ddof=1) / np.sqrt(len(covered)))
    low, high = _COVERS
    yield claim_row(
        "95 % intervals cover 93 … 97 %, pooled",
        f"{100 * share:.2f} ± {100 * error:.2f} %",
        low - _CHANCE * error <= share <= high + _CHANCE * error,
    )


def _design() -> FourierTrajectory:
    return TrajectoryFile.read(ROOT / "benchmarks" / "designs" / "palida_payload.json").trajectory


def _equivalent_run() -> RunConfiguration:
    """Return the shipped run with few samples that tell as much as those at 1 kHz."""
    run = load_run(_RUN)
    noise = run.robot.noise
    if noise is None or noise.force_covariance is None or noise.length_covariance is None:
        raise RuntimeError("the machine that ships states its noise")
    sampling = _SAMPLES / _design().period
    less = sampling / run.run.experiment.sampling
    document: dict[str, Any] = run.run.model_dump(by_alias=True)
    document["experiment"]["sampling"] = sampling
    document["trajectory"]["controller_period"] = None
    document["noise"] = {
        "force_covariance": (less * noise.force_covariance).tolist(),
        "length_covariance": (less * noise.length_covariance).tolist(),
    }
    return load_run(document)


def _true_payload(twin: Twin) -> Array:
    payload = twin.truth.payload
    if payload is None:
        raise RuntimeError("the run states a payload")
    return np.array([payload[name] for name in OF_A_BODY.values()])


def _bare(run: RunConfiguration, twin: Twin) -> tuple[Array, Array]:
    """Return the machine's true parameters without payload, and P of its identification."""
    names = robot_from(run.robot).parameter_names
    carried = twin.truth.payload or {}
    true = twin.truth.values_of(names) - np.array([carried.get(name, 0.0) for name in names])
    covariance = identification_of(run.run.design.priors[0]).covariance_random
    return true, np.array(covariance)


def _repeated(
    run: RunConfiguration, design: FourierTrajectory, numbers: range
) -> tuple[Array, Array, Array]:
    """Return errors, stated standard deviations and widths of intervals, (n, 10) each."""
    robot, twin = robot_from(run.robot), Twin.of(run, design, seed=7)
    true, covariance = _bare(run, twin)
    root, payload = np.linalg.cholesky(covariance), _true_payload(twin)
    machine = run.run.design.prior
    found: list[tuple[Array, Array, Array]] = []
    with threadpool_limits(limits=1):
        for number in numbers:
            rng = np.random.default_rng([11, number])
            drawn = true + root @ rng.standard_normal(len(true))
            values = dict(zip(robot.parameter_names, drawn.tolist(), strict=True))
            known = machine.model_copy(update={"parameters": values})  # type: ignore[union-attr]
            own = run.with_section("estimate", prior=known)
            knowledge = parameter_priors(own, robot)
            experiment = prepare_experiment(own, robot, twin.measurement(number), design)
            (best,) = run_estimators(robot, [experiment], knowledge, ("gm",)).values()
            if not isinstance(knowledge.prior_estimate, UnloadedMachine):
                raise RuntimeError("the prior is an identification")
            one = payload_estimate(best, knowledge.prior_estimate)
            std = np.sqrt(np.diag(one.covariance))
            found.append((one.vector - payload, std, interval_widths(one.freedom)))
    errors, std, widths = (np.array(each) for each in zip(*found, strict=True))
    return errors, std, widths


def _joint_bound(run: RunConfiguration, design: FourierTrajectory) -> Array:
    """Return the inverse of the joint information of payload and machine, of the payload.

    At the truth along the true motion, whose harmonics are unknown too: the columns of the payload
    stand beside those of the machine, whose identification is a prior.
    """
    robot, twin = robot_from(run.robot), Twin.of(run, design, seed=7)
    _, covariance = _bare(run, twin)
    measured = twin.as_measurement(twin.lengths, twin.forces)
    record = fold_recording(measured, design.omega, PeriodSource.DESIGN, average=True)
    motion = HarmonicMotion.of(design, free_frequency=False)
    unknowns = np.zeros((motion.unknowns, motion.unknowns))
    noise = NoiseModel(
        NoiseEstimate(twin.force_noise.covariance, np.inf, "given"),
        NoiseEstimate(twin.length_noise.covariance, np.inf, "given"),
    )
    spread = np.zeros((record.samples, robot.graph.signs.numel()))
    known = MotionEstimate(motion, unknowns, spread)
    experiment = Experiment.along(robot, record, noise, known)
    alone = run.with_section("estimate", prior={})
    knowledge = parameter_priors(alone, robot)
    values = twin.truth.values_of(robot.parameter_names)
    machine = PerturbedMachine.exact(robot)
    equations = machine.joint_equations(experiment, motion, values, knowledge.free)
    information = reduced_information([equations], knowledge)
    places = [robot.parameter_names.index(name) for name in OF_A_BODY.values()]
    scale = np.sqrt(np.diag(information))
    scaled = information / np.multiply.outer(scale, scale)
    prior = np.linalg.inv(covariance * np.multiply.outer(scale, scale))
    joint = np.block(
        [[scaled[np.ix_(places, places)], scaled[places]], [scaled[:, places], scaled + prior]]
    )
    own = np.linalg.inv(joint)[: len(places), : len(places)]
    return own / np.multiply.outer(scale[places], scale[places])


SECTIONS: dict[str, tuple[Callable[[int], Iterator[Row]], int]] = {
    "speed": (speed, 1),
    "montecarlo": (montecarlo, 200),
}
"""How each section is measured, and with how many repetitions."""
