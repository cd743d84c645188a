"""Designs for the noise alone, and for the total error of an estimator, on drawn machines.

Machines are drawn from the tolerances, all of them together with exactly their covariance; their
controllers follow the lengths of the design. Ten periods of some 250 samples have as much less
noise as ten at 1 kHz. Predicted and achieved errors are geometric means over the parameters,
relative to their scales; the achieved ones are root mean squares over the machines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.estimators import ParameterEstimate
from estimation.identification.estimate import identified_robot
from estimation.identification.estimation import (
    add_systematic_uncertainty,
    estimate_parameters,
    parameter_priors,
    run_estimators,
)
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from estimation.twin.machine import draw_machine, machine_within_tolerances
from expdesign import design
from expdesign.configuration import RunConfiguration, load_run, resolved_yaml
from expdesign.configuration.run import robot_yaml
from expdesign.configuration.several_runs import motion_runs
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT
from expdesign.experiment import DesignResult
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.motions import MotionsResult, design_motions
from expdesign.experiment.next_motion import NextResult, compare_with_repetition, next_run
from expdesign.experiment.plan import plan_measurement
from expdesign.experiment.precision import experiment_information, predicted_errors
from expdesign.experiment.setup import plan_search
from expdesign.robot import Robot, robot_from
from expdesign.robot.derived import derived_quantities
from expdesign.robot.deviation import toleranced_deviations
from expdesign.runfolder.files import RUN_FILE
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor

TITLE = "Designs for the total error"

SECTIONS = (
    "palida",
    "palida_quick",
    "palida_terms",
    "linuxcnc",
    "linuxcnc_quick",
    "rubin",
    "interest",
    "interest_quick",
    "motions",
    "motions_linuxcnc",
    "motions_rubin",
    "motions_dehaeze",
    "motions_mathworks",
    "next",
    "prior",
    "plan",
    "plan_linuxcnc",
)
"""Robots, designs for quantities of interest, several motions of palida, or a second one after an
estimate; ``quick``: a search of a minute, as are those of the motions; ``terms``: with tolerances
of terms that the robot lacks."""
_INTERESTS: dict[str, dict[str, Any]] = {
    "all parameters": {},
    "mass, centre": {"interest": ["mass", "centre"]},
    "forces on the circle": {"interest": {"task": "circle"}, "criterion": "a"},
}
_TOLERANCES = {
    "base_joints": "0.1 mm",
    "platform_joints": "0.1 mm",
    "strut_length": "0.1 mm",
    "force_constant": {"common": "0.5 %", "each": "0.5 %"},
    "gravity": "0.1 deg",
}
_TERMS = {
    "drive_inertia": 0.03,
    "force_offset": 1.0,
    "load_friction": 0.01,
    "quadratic_friction": 1.0,
    "asymmetric_friction": 0.5,
}
HELD = {"rubin": [f"p{number}" for number in range(1, 9)]}
"""Parameters that a motion of the robot does not excite: known to design and estimate."""
_PERIODS = 12
"""Of one, two and three motions together."""
_QUICK = {"starts": 16, "hops": 16}
_DESIGNS = {
    "noise": {"counts": "noise"},
    "total, estimated": {"counts": "total"},
    "total, budget": {"counts": "total", "systematic": "budget"},
}
_SAMPLES = 250
"""Of a period."""
_SLOW = ["0.12 Hz", "0.2 Hz"]
"""Frequencies of a motion that shows friction and weight."""
_WISHES = {
    "palida": ("mass=0.6%", "centre=0.05mm", "v1=1%", "mass=0.5%"),
    "linuxcnc": ("mass=1%", "centre=0.4mm", "v1=1%", "mass=0.5%"),
}
_PLANNED = ("periods", "minutes", "wanted σ", "stated by estimates / wanted", "achieved / wanted")
_RATE = 150.0
"""Sampling of the recordings before and after an estimate, Hz."""

Row = dict[str, Any]


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield a row per design of a robot."""
    name, _, variant = section.partition("_")
    quick = variant == "quick"
    terms = {"tolerances": _TOLERANCES | {"terms": _TERMS}}
    more: dict[str, Any] = dict(terms) if variant == "terms" else {}
    if name == "motions":
        yield from _motion_rows(variant or "palida", repetitions or 40)
        return
    if name == "interest":
        yield from _interest_rows(_QUICK if quick else {})
        return
    if name == "next":
        yield from _next_rows(repetitions or 60)
        return
    if name == "prior":
        yield from _prior_rows(repetitions or 60)
        return
    if name == "plan":
        yield from _plan_rows(variant or "palida", repetitions or 60)
        return
    first = np.nan
    for label, settings in _DESIGNS.items():
        search = {"counts": settings["counts"], **(_QUICK if quick else {})}
        systematic = settings.get("systematic", "auto")
        run = _run(name, search, systematic, **more)
        plan_search(run).problem.compile()
        result = design(run)
        seconds = result.solver.cpu_seconds
        first = seconds if label == "noise" else first
        motion = result.trajectory
        row: Row = {"design for": label, "search / that for noise": f"{seconds / first:.1f}"}
        for other in ("auto", "budget"):
            judging = _run(name, {"counts": "total"}, other, **more)
            judged, stated = _predicted(judging, motion)
            row[f"criterion's, {other} (%)"] = f"{100 * _mean(judged):.2f}"
            row[f"predicted, {other} (%)"] = f"{100 * _mean(stated):.2f}"
        count = repetitions or 200
        for estimator, achieved in _achieved(name, [motion], count, **more).items():
            row[f"achieved, {estimator} (%)"] = f"{100 * _mean(achieved):.2f}"
        yield row | {"machines": count}


def _motion_rows(robot: str, count: int) -> Iterator[Row]:
    """Yield the errors of one, two and three motions of the same measuring time."""
    first = np.nan
    for motions in (1, 2, 3):
        search = {**_QUICK, "counts": "noise"}
        run = _run(robot, search, "auto", **_several(motions))
        found: DesignResult | MotionsResult
        if motions == 1:
            found = design(run)
            designs = [found]
            value, seconds = found.criterion_value, found.solver.cpu_seconds
            measuring = found.period * found.experiment.periods
        else:
            found, designs = design_motions(run, Path(), lambda _: nullcontext(Monitor()))
            value, seconds, measuring = (
                found.criterion_value,
                found.cpu_seconds,
                found.measuring_time,
            )
        first = value if motions == 1 else first
        judged = noise_evaluator(run)
        scales = judged.robot.scales[judged.columns]
        predicted = np.array([one.std for one in found.parameters]) / scales
        each = motion_runs(run, Path())[0]
        trajectories = [one.trajectory for one in designs]
        share = _several(1, each)
        achieved = _achieved(robot, trajectories, count, plain=False, **share)["ml estimated"]
        yield {
            "motions": motions,
            "measuring (s)": f"{measuring:.1f}",
            "log det F, mean": f"{value:.3f}",
            "D-efficiency gained (%)": f"{100 * np.expm1((value - first) / len(scales)):.1f}",
            "predicted σ (%)": f"{100 * _mean(predicted):.3f}",
            "achieved, ml estimated (%)": f"{100 * _mean(achieved):.3f}",
            "worst predicted σ (%)": f"{100 * np.max(predicted):.2f}",
            "search (processor s)": f"{seconds:.0f}",
            "drawn": count,
        }


def _several(motions: int, run: RunConfiguration | None = None) -> dict[str, Any]:
    periods = _PERIODS if run is None else run.run.experiment.periods
    return {"trajectory": {"count": motions}, "experiment": {"periods": periods}}


def _plan_rows(robot: str, count: int) -> Iterator[Row]:
    """Yield planned measuring times, and the errors that simulated experiments of them achieve."""
    search = {**_QUICK, "counts": "total"}
    motion = design(_run(robot, search, "auto")).trajectory
    for wish in _WISHES[robot]:
        goals = dict([wish.split("=")])
        (goal, *_) = plan_measurement(_run(robot, search, "auto", goals=goals), motion).goals
        row: Row = {"wish": wish}
        if not goal.reachable:
            cause = f"{goal.source} at {goal.tolerance_percent:.0f} % of its size"
            yield row | dict.fromkeys(_PLANNED, "") | {"periods": "never", "in the way": cause}
            continue
        more = {"experiment": {"periods": int(goal.periods)}}
        fewer = _fewer(robot, _SAMPLES / motion.period, {}, **more)
        nominal = robot_from(fewer.robot)
        derived = derived_quantities(nominal)
        names = (*derived.names, *nominal.parameter_names)
        rows = np.concatenate([derived.jacobian, np.eye(len(nominal.parameters))])
        row_of = rows[names.index(goal.quantity)]
        found = [
            _estimates(fewer, [motion], number, plain=False, draws=draws)["ml estimated"]
            for number, draws in enumerate(_exact_draws(nominal, count))
        ]
        off = np.array([row_of @ (one.values - nominal.parameters) for one in found])
        stated = np.array([np.sqrt(row_of @ one.covariance @ row_of) for one in found])
        yield row | {
            "periods": str(int(goal.periods)),
            "minutes": f"{goal.minutes:.2f}",
            "wanted σ": f"{goal.wanted:.3g}",
            "stated by estimates / wanted": f"{np.sqrt(np.mean(stated**2)) / goal.wanted:.3f}",
            "achieved / wanted": f"{np.sqrt(np.mean(off**2)) / goal.wanted:.3f}",
            "in the way": "",
        }


def _interest_rows(search: dict[str, Any]) -> Iterator[Row]:
    """Yield the predicted errors of quantities of interest for palida without tolerances."""
    about = {"name": "interest", "robot": "palida"}
    circle = load_run(about | {"design": _INTERESTS["forces on the circle"]})
    forces = plan_search(circle).evaluator
    for label, settings in _INTERESTS.items():
        result = design(load_run(about | {"design": {**search, **settings}}))
        derived = {one.quantity: one for one in result.derived}
        samples, periods = result.samples, result.experiment.periods
        variance = forces.value(forces.information(result.trajectory, samples))
        whole = periods * result.samples_per_period / samples
        yield {
            "design for": label,
            "log det F": f"{result.log_det_information:.2f}",
            "σ of the mass (g)": f"{1e3 * derived['mass'].std:.2f}",
            "σ of the centre (µm)": f"{1e6 * derived['centre_z'].std:.2f}",
            "rms error of a force on the circle (mN)": f"{1e3 * np.sqrt(variance / whole / 6):.1f}",
        }


def summary(table: pd.DataFrame) -> str:
    """Return the gains of the designs for the total, or for the quantities of interest."""
    if "motions" in table:
        gained = table["D-efficiency gained (%)"].tolist()
        return f"gain of two motions {gained[1]} %, of three {gained[2]} %"
    if "wish" in table:
        return f"{sum(table['periods'] != 'never')} of {len(table)} wishes are reached"
    if "recordings" in table:
        again, following = (float(table["achieved (%)"][k]) for k in (1, 2))
        return f"error after the next motion: {following / again:.2f} of that after repeating"
    if "machines" not in table:
        return "smallest: " + ", ".join(
            f"{name} {table['design for'][table[name].astype(float).idxmin()]}"
            for name in table.columns[2:]
        )
    noise, auto, budget = (table.iloc[k] for k in range(3))
    gains = [
        f"{kind}: {float(own[key]) / float(noise[key]):.2f} of the error"
        for kind, own, key in (
            ("estimated", auto, "achieved, ml estimated (%)"),
            ("budget", budget, "achieved, ml budget (%)"),
        )
    ]
    return "; ".join(gains)


def _run(robot: str, search: dict[str, Any], systematic: str, **more: Any) -> RunConfiguration:
    held = HELD.get(robot, [])
    return load_run(
        {
            "name": f"totals-{robot}",
            "robot": robot,
            "tolerances": _TOLERANCES,
            "design": search | ({"known": held} if held else {}),
            "estimate": {"systematic": systematic, "fixed": held},
        }
        | more
    )


def _mean(errors: Array) -> float:
    return float(np.exp(np.mean(np.log(errors))))


def _predicted(run: RunConfiguration, motion: FourierTrajectory) -> tuple[Array, Array]:
    """Return relative standard deviations of the whole experiment.

    Those that the criterion judges, and those that a design states.
    """
    evaluator, noise = plan_search(run).evaluator, noise_evaluator(run)
    samples, experiment = run.run.trajectory.samples, run.run.experiment
    total = experiment.periods * experiment.sampling * motion.period
    information = evaluator.whole_information(motion, samples) * (total / samples)
    assert evaluator.marginal is not None
    judged = evaluator.judged(information, evaluator.marginal.samples)
    whole, count = experiment_information(noise, motion, run)
    stated = predicted_errors(run, noise, motion, whole, count)
    std = np.sqrt(np.diag(np.linalg.inv(judged)))
    scales = evaluator.robot.scales[evaluator.columns]
    return std / scales, stated.std / scales


def _achieved(
    robot_name: str,
    motions: Sequence[FourierTrajectory],
    count: int,
    *,
    plain: bool = True,
    **more: Any,
) -> dict[str, Array]:
    """Return the relative rms errors of each estimator over drawn machines."""
    sampling = _SAMPLES / motions[0].period
    fewer = _fewer(robot_name, sampling, {}, **more)
    errors: dict[str, list[Array]] = {}
    robot = robot_from(fewer.robot)
    draws = _exact_draws(robot, count)
    free = [name not in HELD.get(robot_name, ()) for name in robot.parameter_names]
    for number in range(count):
        estimates = _estimates(fewer, motions, number, plain=plain, draws=draws[number])
        for name, found in estimates.items():
            off = (found.values - robot.parameters) / robot.scales
            errors.setdefault(name, []).append(off[free])
    return {name: np.sqrt(np.mean(np.square(each), axis=0)) for name, each in errors.items()}


def _fewer(
    robot_name: str, sampling: float, search: dict[str, Any], **more: Any
) -> RunConfiguration:
    """Return the run with fewer samples of as much less noise."""
    stated = _run(robot_name, search, "auto", **more)
    less = sampling / stated.run.experiment.sampling
    noise = stated.robot.noise
    assert noise is not None
    assert noise.force_covariance is not None
    assert noise.length_covariance is not None
    return _run(
        robot_name,
        search,
        "auto",
        **more
        | {
            "experiment": {**more.get("experiment", {}), "sampling": sampling},
            "noise": {
                "force_covariance": (less * noise.force_covariance).tolist(),
                "length_covariance": (less * noise.length_covariance).tolist(),
            },
        },
    )


def _next_rows(count: int) -> Iterator[Row]:
    """Yield the errors after one recording, and after a second one, the same or the next motion."""
    run = _fewer("palida", _RATE, _QUICK)
    plan_search(run).problem.compile()
    first = design(run).trajectory
    with TemporaryDirectory() as place:
        following = next_run([_estimated(run, first, Path(place), count)])
    second = design(following).trajectory
    cases = {
        "first": ("std_measured", [first]),
        "first, and again": ("std_repeated", [first, first]),
        "first, and next": ("std_next", [first, second]),
    }
    yield from _rows_after(
        following, compare_with_repetition(following, second, first), cases, count
    )


def _prior_rows(count: int) -> Iterator[Row]:
    """Yield the errors after a slow motion, for friction and weight, and after a second one.

    The second motion is designed without or with the first recording as a prior.
    """
    slow = _fewer("palida", _RATE, _QUICK, trajectory={"frequency": _SLOW})
    first = design(slow).trajectory
    with TemporaryDirectory() as place:
        folder = _estimated(slow, first, Path(place), count)
        following = _fewer("palida", _RATE, {**_QUICK, "prior": str(folder)})
    alone = design(_fewer("palida", _RATE, _QUICK)).trajectory
    second = design(following).trajectory
    cases = {
        "slow": ("std_measured", [first]),
        "slow, and one designed alone": ("std_repeated", [first, alone]),
        "slow, and one designed with it": ("std_next", [first, second]),
    }
    yield from _rows_after(
        following, compare_with_repetition(following, second, alone), cases, count
    )


def _estimated(run: RunConfiguration, motion: FourierTrajectory, folder: Path, seed: int) -> Path:
    """Return a run folder with an estimate from a recording of a drawn machine.

    With the nominal one the lengths show no harmonics but those of the design, and its estimate
    states smaller errors.
    """
    drawn = draw_machine(run, np.random.default_rng([1, seed])).configuration
    found = estimate_parameters(run, Twin.of(drawn, motion, seed=seed).measurement(1), motion)
    identified = robot_yaml(identified_robot(found, None))
    (folder / IDENTIFIED_ROBOT).write_text(identified, encoding="utf-8")
    (folder / RUN_FILE).write_text(resolved_yaml(run), encoding="utf-8")
    return folder


def _rows_after(
    run: RunConfiguration,
    predicted: NextResult,
    cases: dict[str, tuple[str, list[FourierTrajectory]]],
    count: int,
) -> Iterator[Row]:
    """Yield predicted and achieved errors of recordings of some motions, estimated together."""
    robot = robot_from(run.robot)
    derived = derived_quantities(robot)
    draws = _exact_draws(robot, count)
    for label, (key, motions) in cases.items():
        errors, own = list[Array](), list[Array]()
        for number in range(count):
            every = _estimates(run, motions, number, plain=False, draws=draws[number])
            values = every["ml estimated"].values - robot.parameters
            errors.append(values / robot.scales)
            own.append(derived.jacobian @ values)
        stated = {one.quantity: getattr(one, key) for one in predicted.gains}
        std = np.array([stated[name] for name in robot.parameter_names]) / robot.scales
        rms, whole = (np.sqrt(np.mean(np.square(each), axis=0)) for each in (errors, own))
        mass, centre = (derived.names.index(name) for name in ("mass", "centre_z"))
        yield {
            "recordings": label,
            "predicted (%)": f"{100 * _mean(std):.2f}",
            "achieved (%)": f"{100 * _mean(rms):.2f}",
            "achieved / predicted": f"{_mean(rms) / _mean(std):.3f}",
            "mass, predicted (g)": f"{1e3 * stated['mass']:.1f}",
            "mass, achieved (g)": f"{1e3 * whole[mass]:.1f}",
            "centre z, predicted (µm)": f"{1e6 * stated['centre_z']:.1f}",
            "centre z, achieved (µm)": f"{1e6 * whole[centre]:.1f}",
            "machines": count,
        }


def _exact_draws(robot: Robot, count: int) -> Array:
    """Return draws, (count, t), with exactly the covariance of the tolerances.

    Few draws of one that dominates, such as the force constant, would be too large or too small.
    Fewer draws than tolerances are random.
    """
    drawn = np.random.default_rng(0).standard_normal((count, len(toleranced_deviations(robot))))
    if count < drawn.shape[1]:
        return drawn
    draws: Array = np.linalg.qr(drawn)[0] * np.sqrt(count)
    return draws


def _estimates(
    run: RunConfiguration,
    motions: Sequence[FourierTrajectory],
    number: int,
    *,
    plain: bool,
    draws: Array,
) -> dict[str, ParameterEstimate]:
    drawn = machine_within_tolerances(run, draws)
    with threadpool_limits(limits=1):
        robot = robot_from(run.robot)
        priors, chosen = parameter_priors(run, robot), toleranced_deviations(robot)
        experiments = [
            prepare_experiment(
                run, robot, Twin.of(drawn.configuration, one, seed=number).measurement(k), one
            )
            for k, one in enumerate(motions, start=1)
        ]
        names = ("gm", "ml") if plain else ()
        budgets = run_estimators(robot, experiments, priors, names)
        joint = run_estimators(robot, experiments, priors, ("ml",), chosen)
    return {
        f"{name} budget": add_systematic_uncertainty(found, priors, chosen)
        for name, found in budgets.items()
    } | {"ml estimated": joint["ml"]}
