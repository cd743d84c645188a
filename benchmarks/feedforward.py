"""Feed-forward of the identified model on PaLiDA's twin, and the forward dynamics by itself.

Section `loop`: experiments of 10 periods of the best known design, with the robot's noise, are
estimated; the twin then follows motions that were not measured, under the controller that
`feedforward: {}` has. Claimed of every experiment: the rms error of the struts is at least five
times smaller than without feed-forward, and the way of the struts is within 2 % of that error of
where the true model's forces bring them. Section `dynamics`: the inverse dynamics backwards,
energy, order of the steps, width of the smoothed friction, and the simulator MuJoCo with the same
bodies, forces and controller.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from constraints.arrays import Array
from estimation.feedforward.closed_loop import ForwardDynamics, Model
from estimation.feedforward.comparison import WIDTH, compare_feedforward
from estimation.feedforward.result import FeedforwardResult
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.estimate import identified_model
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import Robot, load_robot
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from tests.feedforward.energy import energy
from tests.multibody.driven import COMPENSATED, DAMPING, STIFFNESS, drive
from tests.multibody.inverse import ExactMachine
from tests.multibody.machine import Bodies, Geometry

TITLE = "Feed-forward of the identified model"

Row = dict[str, Any]

REDUCTION, LEFT = 5.0, 0.02
"""Claimed: times smaller, and share of the error without feed-forward."""

ESTIMATORS = ("gm", "ml")

_DESIGN = Path(__file__).parent / "designs" / "palida_former.json"
_SLOWER = Path(__file__).parent / "designs" / "palida.json"
_REPETITIONS = 5
_SAMPLES = 1667
_STEP = 0.1e-3
"""Of MuJoCo's simulation [s]."""


@dataclass(frozen=True)
class Case:
    """A true machine, by factors of the robot's parameters, and what is followed."""

    machine: str
    followed: str
    motion: dict[str, Any]
    factors: dict[str, float]


_HEAVIER = {"p10": 1.2, "p9": 1.2, "p6": 1.2, "p7": 1.2, "p8": 1.2, "p4": 1.1} | {
    f"{name}{j}": 1.5 for name in ("r", "v") for j in range(1, 7)
}
_HEAVIER |= {"r_alpha": 1.5, "r_beta": 1.5}
_CIRCLE: dict[str, Any] = {"motion": "circle"}
_MIRRORED = _CIRCLE | {"mirror": "xz"}
_FLAT = _CIRCLE | {"normal": [0, 0, 1], "radius": 0.1, "speed": 0.5}

CASES = (
    Case("as the robot file says", "circle, 1 m/s", _CIRCLE, {}),
    Case("as the robot file says", "circle, mirrored xz, 1 m/s", _MIRRORED, {}),
    Case("as the robot file says", "flat circle, 0.5 m/s", _FLAT, {}),
    Case("platform 20 % heavier, friction half as large again", "circle, 1 m/s", _CIRCLE, _HEAVIER),
    Case(
        "platform 20 % heavier, friction half as large again",
        "circle, mirrored xz, 1 m/s",
        _MIRRORED,
        _HEAVIER,
    ),
)

SECTIONS = ("loop", "dynamics")


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` experiments instead of five."""
    if section == "dynamics":
        yield from _dynamics()
        return
    estimates: dict[str, list[dict[str, Any]]] = {}
    for case in CASES:
        count = repetitions or _REPETITIONS
        run = _run(case)
        if case.machine not in estimates:
            estimates[case.machine] = [_estimates(run, k) for k in range(1, count + 1)]
        for name in ESTIMATORS:
            found = [compare_feedforward(run, made[name], None) for made in estimates[case.machine]]
            yield _loop_row(case, name, found)


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold, and the controller."""
    judged = table[table["holds"] != ""]
    text = f"{int((judged['holds'] == 'yes').sum())} of {len(judged)} claims hold"
    if "true machine" in table:
        text += (
            ". Rms errors of all struts, mean over the experiments; the controller of every strut: "
            "10 Hz, damping ratio 0.7, integral action from 1 Hz, filter 100 Hz, sampled at 1 kHz, "
            "so k = 26.6 kN/m, d = 592 N s/m, k_i = 167 kN/(m s) for 6.73 kg"
        )
    return text


def _run(case: Case) -> RunConfiguration:
    experiment: dict[str, Any] = {"seed": 1}
    if case.factors:
        about = load_robot_description("palida")
        values = {n: v * case.factors.get(n, 1.0) for n, v in about.parameters.items()}
        experiment["truth"] = about.description.model_copy(update={"parameters": values})
    return load_run(
        {
            "name": "feedforward",
            "robot": "palida",
            "experiment": experiment,
            "estimate": {"estimators": list(ESTIMATORS)},
            "feedforward": case.motion,
        }
    )


def _estimates(run: RunConfiguration, repetition: int) -> dict[str, Any]:
    design = TrajectoryFile.read(_DESIGN).trajectory
    data = Twin.of(run, design).measurement(repetition)
    found = estimate_parameters(run, [data], [design])
    result = estimation_result(found)
    return {name: identified_model(result, Path(), found.robot, name) for name in ESTIMATORS}


def _loop_row(case: Case, estimator: str, found: list[FeedforwardResult]) -> Row:
    def mean(name: str) -> str:
        sizes = [each.rms_struts for one in found for each in one.cases if each.case == name]
        return f"{1e6 * np.mean(sizes):.1f}" if sizes else "the true one"

    reduction = min(one.case("identified").reduction for one in found)
    left = max(one.left for one in found)
    return {
        "true machine": case.machine,
        "motion": case.followed,
        "estimator": estimator,
        "experiments": len(found),
        **{f"{name} [µm]": mean(name) for name in ("none", "gravity", "nominal")},
        **{f"{name} [µm]": mean(name) for name in ("identified", "true")},
        f"smallest reduction, {REDUCTION:g} or more": f"{reduction:.1f}",
        f"largest way from the true model's, {100 * LEFT:g} % at most": f"{100 * left:.2f} %",
        "half step and width": f"{100 * max(one.integration.change for one in found):.3f} %",
        "holds": ("no", "yes")[reduction >= REDUCTION and left <= LEFT],
    }


def _dynamics() -> Iterator[Row]:
    robot = load_robot("palida")
    motion = TrajectoryFile.read(_DESIGN).trajectory
    states = motion.sample(motion.sample_times(_SAMPLES))
    wanted = np.abs(states.acceleration).max()
    machine = ForwardDynamics(Model(robot, robot.parameters), 1e-12)
    found = machine.acceleration(np.hstack(states[:2]), robot.actuator_forces(*states))
    off = float(np.abs(found - states.acceleration).max() / wanted)
    yield _row(
        "forward after inverse dynamics along the design: at most 1e-10 of the acceleration",
        f"{off:.1e}",
        off < 1e-10,  # noqa: PLR2004
    )
    geometry, bodies = Geometry.of(robot), Bodies()
    exact = ExactMachine(geometry, bodies).simulate(*(part[::8] for part in states))
    values = bodies.parameters(geometry.platform_joints)
    machine = ForwardDynamics(Model(robot, values), 1e-12)
    found = machine.acceleration(np.hstack([part[::8] for part in states[:2]]), exact.forces)
    off = float(np.abs(found - states.acceleration[::8]).max() / wanted)
    yield _row(
        "the same with MuJoCo's forces: at most 1e-9 of the acceleration",
        f"{off:.1e}",
        off < 1e-9,  # noqa: PLR2004
    )
    yield from _energy(robot, states[0][0], states[1][0])
    yield from _driven(robot, geometry, bodies)
    yield from _widths()


def _energy(robot: Robot, pose: Array, rate: Array) -> Iterator[Row]:
    """Let the machine go without friction: energy stays, and the steps are of order four."""
    values = _frictionless(robot)
    machine = ForwardDynamics(Model(robot, values), 1e-3)
    start = np.concatenate([pose, rate])[None]
    ends = {}
    for steps in (25, 50, 100):
        state, advance = start, machine.stepper(0.1 / steps)
        for _ in range(steps):
            state, _ = advance(state, np.zeros((1, 6)))
        ends[steps] = state[0]
    before, after = (energy(robot, values, each[:6], each[6:]) for each in (start[0], ends[100]))
    kinetic = before - energy(robot, values, pose, np.zeros(6))
    drift = abs(after - before) / kinetic
    yield _row(
        "energy after a free fall of 0.1 s in steps of 1 ms: within 1e-7 of the kinetic energy",
        f"{drift:.1e}",
        drift < 1e-7,  # noqa: PLR2004
    )
    first, second = (np.abs(ends[a] - ends[b]).max() for a, b in ((25, 50), (50, 100)))
    yield _row(
        "half the step: 16 times less error, 13 or more",
        f"{first / second:.1f}",
        first / second > 13,  # noqa: PLR2004
    )


def _frictionless(robot: Robot) -> Array:
    dry = [name[0] in "rv" for name in robot.parameter_names]
    return np.where(dry, 0.0, robot.parameters)


def _driven(robot: Robot, geometry: Geometry, bodies: Bodies) -> Iterator[Row]:
    """Drive MuJoCo's machine and ours by the same controller.

    MuJoCo's speeds are those half a step before its positions, (q_k − q_{k−1})/h, and its forces
    act at the sample, ours until the next one: they are fed forward for the middle of the step.
    """
    design = json.loads(_SLOWER.read_text(encoding="utf-8"))
    reference = drive(geometry, bodies, design, _SAMPLES, longest=_STEP)
    values = bodies.parameters(geometry.platform_joints)
    motion: FourierTrajectory = TrajectoryFile.read(_SLOWER).trajectory
    substeps = int(np.ceil(motion.period / _SAMPLES / _STEP))
    steps = _SAMPLES * substeps
    states = motion.sample(motion.sample_times(steps))
    struts = robot.strut_motion(*states)
    dry = np.array([name.startswith("r") for name in robot.parameter_names])
    known = values * np.where(dry, COMPENSATED, 1.0)
    step = motion.period / steps
    middle = motion.sample(motion.sample_times(steps) + step / 2)
    fed = robot.actuator_forces(*middle, known)
    machine = ForwardDynamics(Model(robot, values), 1e-3)
    advance = machine.stepper(step)
    before = struts.length[0] - step * struts.length_rate[0]
    state = np.concatenate([states.pose[0], states.rate[0]])[None]
    tracking = np.empty((2 * steps, 6))
    for k in range(2 * steps):
        now = k % steps
        length = robot.inverse_kinematics(state[0, :6])
        error = struts.length[now] - length
        speed = struts.length_rate[now] - (length - before) / step
        tracking[k], before = -error, length
        state, _ = advance(state, (fed[now] + STIFFNESS * error + DAMPING * speed)[None])
    # MuJoCo's recording begins within the first period.
    begin = round(0.738 * _SAMPLES) * substeps
    ours = tracking[begin : begin + steps : substeps]
    sizes = [1e6 * float(np.sqrt(np.mean(each**2))) for each in (reference.tracking, ours)]
    apart = 1e6 * float(np.sqrt(np.mean((reference.tracking - ours) ** 2)))
    yield _row("rms tracking error of MuJoCo's machine, stiff controller", f"{sizes[0]:.1f} µm")
    yield _row("the same of ours", f"{sizes[1]:.1f} µm")
    yield _row(
        "rms difference of the two: at most a tenth of the error",
        f"{apart:.2f} µm",
        apart < sizes[0] / 10,
    )


def _widths() -> Iterator[Row]:
    """Follow the circle with other widths of the smoothed friction."""
    run = _run(CASES[0])
    saved = _estimates(run, 1)["gm"]
    found = [compare_feedforward(run, saved, None, factor * WIDTH) for factor in (4.0, 1.0, 0.25)]
    for name in ("none", "identified", "true"):
        sizes = [1e6 * one.case(name).rms_struts for one in found]
        yield _row(
            f"rms error, {name}, with 4, 1 and 1/4 of the usual width of smoothed friction",
            ", ".join(f"{size:.2f}" for size in sizes) + " µm",
        )


def _row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
