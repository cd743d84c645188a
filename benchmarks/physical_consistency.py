"""PaLiDA's estimates beside the nearest ones that bodies have, with true bodies at their limits.

Estimates are drawn with the covariance of an ML estimate of ten periods of the design of n = 5:
normal about a truth that some bodies have. What comes out is judged by the bodies that come with
it. `…-significance` tests the distance of each draw, which takes up to 1200
projections. `…-experiments`
draws nothing: it measures the machine with that truth on the twin, estimates by ML and tests that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np

from benchmarks.studies import (
    Row,
    claim_row,
    equivalent_run,
    palida_design,
    sampled_experiment,
    summary,
)
from constraints.arrays import Array
from estimation.estimators import ParameterEstimate, ParameterPriors
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from estimation.uncertainty.consistency import ConsistentEstimate, consistent_estimate
from expdesign.configuration import RunConfiguration
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.bodies import MachineBodies, RigidBody
from expdesign.mechanism.nearest import Nearest, Projection
from expdesign.robot import Robot, robot_from

TITLE = "Physically consistent estimates"

__all__ = ["SECTIONS", "TITLE", "rows", "summary"]

_ROUNDING = 1e-12
_AGREE, _NEAREST = 1e-6, 2e-3
_LONGEST = 1.0
_SIGNIFICANCE, _EXPERIMENTS = "-significance", "-experiments"
_NAME, _SAMPLES = "physical-consistency", 250
_LEVEL = 0.05


@cache
def _machine() -> tuple[Robot, ParameterPriors, ParameterEstimate]:
    run = equivalent_run(_NAME, _SAMPLES)
    robot = robot_from(run.robot)
    knowledge = parameter_priors(run, robot)
    return robot, knowledge, next(_measured(run, 1))


def _measured(run: RunConfiguration, count: int) -> Iterator[ParameterEstimate]:
    """Yield ML estimates of so many whole experiments on the twin."""
    robot, design = robot_from(run.robot), palida_design()
    knowledge, twin = parameter_priors(run, robot), Twin.of(run, design, seed=5)
    for number in range(1, count + 1):
        experiment = prepare_experiment(run, robot, twin.measurement(number), design)
        yield run_estimators(robot, [experiment], knowledge, ("gm", "ml"))["ml"]


def _machine_of(truth: Array) -> RunConfiguration:
    """Return a run with PaLiDA's file on a machine with other parameters."""
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    file["parameters"] |= dict(zip(_machine()[0].parameter_names, truth.tolist(), strict=True))
    return equivalent_run(
        _NAME, _SAMPLES, experiment=sampled_experiment(_SAMPLES) | {"truth": file}
    )


def _truth(**changes: float) -> Array:
    """Return PaLiDA's parameters with these, p3 made p2 plus twice the struts' ∫ x² dm."""
    robot, _, _ = _machine()
    width = changes.pop("width", 0.02)
    named = dict(zip(robot.parameter_names, robot.parameters.tolist(), strict=True))
    named |= {"p1": width + changes.pop("height", 0.01), "p3": named["p2"] + 2 * width}
    return np.array([{**named, **changes}[name] for name in robot.parameter_names])


def _point_platform(**changes: float) -> Array:
    """Return parameters with the lightest sliders, and a platform beside them that is one point."""
    robot, _, _ = _machine()
    values = _truth(**changes)
    rest = robot.realisable.with_lightest_sliders(values)
    if rest is None:
        raise RuntimeError("PaLiDA has a platform and struts")
    eigenvalues, axes = np.linalg.eigh(rest)
    small = axes[:, :3] * eigenvalues[:3]
    flat = values - robot.realisable.of_platform(small @ axes[:, :3].T)
    # Joints that are rounded have no symmetry to the last digit, which the model's platform has.
    every = np.full(len(flat), True)
    return Projection(robot.realisable, np.diag(robot.scales), every).of(flat).values


_TRUTHS: dict[str, Callable[[], Array]] = {
    "inside": _truth,
    "thin-struts": partial(_truth, width=0.0),
    "thinnest-struts": partial(_truth, width=0.0, height=0.0),
    "no-friction": partial(_truth, r2=0.0, r5=0.0, r6=0.0, r_alpha=0.0),
    "point-platform": _point_platform,
    "all-of-it": partial(
        _point_platform, width=0.0, height=0.0, r2=0.0, r5=0.0, r6=0.0, r_alpha=0.0
    ),
}
"""From inside to corners."""

SECTIONS = tuple(name + way for way in ("", _SIGNIFICANCE, _EXPERIMENTS) for name in _TRUTHS)


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield what is claimed of one kind of truth."""
    robot, knowledge, estimate = _machine()
    truth = _TRUTHS[section.removesuffix(_SIGNIFICANCE).removesuffix(_EXPERIMENTS)]()
    count = repetitions or 1000
    yield claim_row("some bodies have the truth", *_words(_has(robot, truth)))
    if section.endswith(_EXPERIMENTS):
        yield from _tested(truth, _measured(_machine_of(truth), count))
        return
    projection = Projection.by(estimate.covariance, robot.realisable, knowledge.free)
    draws = np.random.default_rng(1).standard_normal((count, len(truth)))
    values = truth + draws @ projection.factor.T
    if section.endswith(_SIGNIFICANCE):
        known = replace(estimate, freedom=np.full(len(truth), np.inf))
        yield from _tested(truth, (replace(known, values=each) for each in values))
        return
    found: list[Nearest] = []
    seconds = []
    for each in values:
        began = time.process_time()
        found.append(projection.of(each))
        seconds.append(time.process_time() - began)
    wrong = sum(not _are_of(robot, one.bodies, one.values) for one in found)
    yield claim_row(f"{count} of {count} are of bodies", f"{count - wrong} of {count}", not wrong)
    least = min(_least(one.bodies) for one in found)
    yield claim_row("least eigenvalue of their pseudo-inertias, over the largest", f"{least:.1e}")
    longest = max(seconds)
    text = f"{longest:.3f} s, median {1e3 * np.median(seconds):.1f} ms"
    yield claim_row(f"each in less than {_LONGEST:g} s of processor time", text, longest < _LONGEST)
    own = [robot.realisable.bodies(each) is not None for each in values]
    apart = [
        float(np.max(np.abs(one.values - each) / estimate.std))
        for one, each, inside in zip(found, values, own, strict=True)
        if inside
    ]
    yield claim_row(
        f"where bodies have the estimate both agree to {_AGREE:g} σ",
        f"{max(apart, default=0.0):.1e} σ in {sum(own)} of {count}",
        max(apart, default=0.0) <= _AGREE,
    )
    short = max((one.distance - one.least for one in found), default=0.0)
    yield claim_row(
        f"none is nearer, by the dual, to {_NEAREST:g} σ", f"{short:.1e} σ", short <= _NEAREST
    )
    yield from _errors(truth, values, np.array([one.values for one in found]), estimate)


def _errors(truth: Array, values: Array, near: Array, estimate: ParameterEstimate) -> Iterator[Row]:
    """Yield how large the errors are beside those of the estimate without constraints."""
    rms = np.sqrt(np.mean((near - truth) ** 2, axis=0)) / estimate.std
    without = np.sqrt(np.mean((values - truth) ** 2, axis=0)) / estimate.std
    robot, _, _ = _machine()
    worst, best = int(np.argmax(rms / without)), int(np.argmin(rms / without))
    names = robot.parameter_names
    text = (
        f"{rms[worst] / without[worst]:.3f} ({names[worst]}), least "
        f"{rms[best] / without[best]:.3f} ({names[best]})"
    )
    yield claim_row(
        "root mean square error over that without constraints, largest",
        text,
        bool(rms[worst] <= without[worst] * (1 + 3 / np.sqrt(2 * len(values)))),
    )
    inside = np.abs(near - truth) <= 1.96 * estimate.std
    cover = np.mean(inside, axis=0)
    error = np.sqrt(0.05 * 0.95 / len(values))
    yield claim_row(
        "consistent ± 1.96 σ holds the truth in 95 % at least, every parameter",
        f"{100 * np.mean(cover):.1f} %, least {100 * np.min(cover):.1f} ± {100 * error:.1f} %",
        bool(np.min(cover) >= 0.95 - 3.5 * error),
    )


def _tested(truth: Array, estimates: Iterator[ParameterEstimate]) -> Iterator[Row]:
    """Yield whether bodies have them all, how often the test rejects, and the spread's worth."""
    robot, knowledge, _ = _machine()
    found, apart = [], []
    for estimate in estimates:
        one = consistent_estimate(robot, estimate, knowledge)
        found.append(one)
        if one is not None and robot.realisable.bodies(estimate.values) is not None:
            apart.append(float(np.max(np.abs(one.vector - estimate.values) / estimate.std)))
    there = [one for one in found if one is not None]
    kept = sum(_are_of(robot, _bodies(one), one.vector) for one in there)
    count = len(found)
    yield claim_row(f"{count} of {count} are of bodies", f"{kept} of {count}", kept == count)
    most = max(apart, default=0.0)
    yield claim_row(
        f"where bodies have the estimate both agree to {_AGREE:g} σ",
        f"{most:.1e} σ in {len(apart)} of {count}",
        most <= _AGREE,
    )
    level = float(np.mean([one.significant for one in there]))
    error = float(np.sqrt(_LEVEL * (1 - _LEVEL) / count))
    yield claim_row(
        "told as significant at 5 % in 5 % of the cases at most",
        f"{100 * level:.1f} ± {100 * error:.1f} % of {count}",
        level <= _LEVEL + 2.5 * error,
    )
    rms = np.sqrt(np.mean([(one.vector - truth) ** 2 for one in there], axis=0))
    spread = np.sqrt(np.mean([one.spread**2 for one in there], axis=0))
    ratio = rms / spread
    yield claim_row(
        "root mean square error over the spread told: mean, least, largest",
        f"{np.mean(ratio):.2f}, {np.min(ratio):.2f}, {np.max(ratio):.2f}",
    )


def _words(holds: bool) -> tuple[str, bool]:
    return "yes" if holds else "no", holds


def _has(robot: Robot, values: Array) -> bool:
    found = robot.realisable.bodies(values)
    return found is not None and _are_of(robot, found, values)


def _bodies(one: ConsistentEstimate) -> MachineBodies:
    return MachineBodies(**{name: RigidBody(**vars(body)) for name, body in one.bodies.items()})


def _are_of(robot: Robot, bodies: MachineBodies, values: Array) -> bool:
    """Judge by the bodies alone: they are bodies, and they have the parameters."""
    made = bodies.parameters(robot.description.platform_joints)
    named = zip(robot.parameter_names, values.tolist(), robot.scales.tolist(), strict=True)
    same = all(abs(made.get(n, v) - v) <= _ROUNDING * max(s, 1.0) for n, v, s in named)
    bounds = robot.realisable
    kept = bool(np.all((values >= bounds.lower) & (values <= bounds.upper)))
    return same and kept and _least(bodies) >= -_ROUNDING


def _least(bodies: MachineBodies) -> float:
    """Return the least eigenvalue of all pseudo-inertias, over the largest of each."""
    found = []
    for body in vars(bodies).values():
        second = np.trace(body.inertia) / 2 * np.eye(3) - body.inertia
        whole = np.block([[second, body.moment[:, None]], [body.moment, np.array(body.mass)]])
        eigenvalues = np.linalg.eigvalsh(whole)
        found.append(eigenvalues[0] / eigenvalues[-1])
    return float(min(found))
