"""Deviations θ of a machine from its description, and the derivatives of a motion to them.

θ is zero for the machine of the robot file. Its standard deviations are those of the file's
`tolerances`; an entry without one has 0: it is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import casadi as ca
import numpy as np
from pydantic import Field

from constraints.arrays import Array
from expdesign.configuration.robot import ResolvedRobot, RobotDescription
from expdesign.configuration.schema import read_only
from expdesign.configuration.tolerances import (
    EACH_PARAMETER,
    ChannelTimeTolerance,
    ForceConstantTolerance,
    MotorTolerance,
    RobotTolerances,
)
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES, actuator_names
from expdesign.mechanism.term import Friction, Term, kinematic_terms, parameters_of
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.robot.robot import Robot
from expdesign.runfolder import UnboundedNumber, described

FORCE_CONSTANT = "force_constant"
"""Name of the deviation of all forces; ``force_constant_1`` … of one actuator."""
_AXES = ("x", "y", "z")
JOINT_ENTRIES = len(_AXES) * ACTUATORS
"""Number of coordinates of the joints of base or platform."""
TILTS = 2
_ALONG = 0.9
_MOST_OFF = 0.9
"""Largest relative error of a positive constant."""


@dataclass(frozen=True)
class Deviation:
    """One entry of θ."""

    name: Annotated[str, described("", "name, such as base_joint_1_x")]
    group: Annotated[str, described("", "key of its tolerance in the robot file")]
    unit: Annotated[str, described("", "SI unit of tolerance, value and std")]
    tolerance: Annotated[
        UnboundedNumber,
        described("see unit", "standard deviation in the robot file; null: nothing was known"),
    ]
    """0: exact; inf: nothing is known."""
    lower: Annotated[float, Field(exclude=True)] = -np.inf
    """Smallest value of θ, finite for a constant that must be positive."""

    @property
    def key(self) -> tuple[str, float]:
        """Name and tolerance: with both equal, entries of two estimates are the same number."""
        return self.name, self.tolerance

    @property
    def channel(self) -> int:
        """Number of the actuator, from zero, at the end of the name."""
        return int(self.name.rpartition("_")[2]) - 1

    @property
    def of_the_machine(self) -> bool:
        """True for deviations of the model itself, false for errors of the measurement."""
        return self.group not in _MEASURED


CHANNEL_DELAYS = {"Q": "channel_delay.forces", "q": "channel_delay.lengths"}
"""Groups of the delays of single channels, of forces and lengths."""
LOW_PASSES = {"Q": "low_pass.forces", "q": "low_pass.lengths"}
"""Groups of the time constants of first-order low passes of single channels."""
MOVING_GROUPS = ("base_joints", "platform_joints", "strut_length")
"""Deviations by which a machine moves otherwise than its lengths say."""
LAGS_OF_FORCES = ("delay", CHANNEL_DELAYS["Q"], LOW_PASSES["Q"])
MOTOR_EFFECTS = {"constant": (1, -2), "resistance": (-1, 1), "supply": (1, 0)}
"""Relative changes of the forces K/R u and of the damping K²/R per relative error of a motor's
constant, resistance or supply: u and K/R are taken too large, and K²/R too large."""
MOTOR_GROUPS = tuple(
    f"motor.{name}.{part}" for name in MOTOR_EFFECTS for part in ("common", "each")
)
_MEASURED = (
    "strut_length",
    "force_constant.common",
    "force_constant.each",
    *MOTOR_GROUPS,
    "delay",
    *CHANNEL_DELAYS.values(),
    *LOW_PASSES.values(),
    "clock",
)


def deviations(robot: Robot) -> tuple[Deviation, ...]:
    """Return every entry of θ, with its standard deviation by the robot's tolerances.

    In this order: ``base_joint_1_x`` … ``base_joint_6_z`` (m, base frame), ``platform_joint_1_x``
    … (m, platform frame), ``gravity_1`` and ``gravity_2`` (rad: its direction turned about two
    axes across it), the constants of the terms (``<term>_<constant>``), the parameters of lacking
    terms (``<term>_<parameter>``, see `Robot.extended`), ``strut_length_1`` … (m: a length is
    measured too long), ``force_constant`` (a share: all forces are measured too large),
    ``force_constant_1`` … (one of them is), for forces of voltages ``motor_constant``,
    ``motor_constant_1`` … and the same of ``motor_resistance`` and ``motor_supply`` (shares by
    which they are taken too large), ``delay`` (s: forces lag behind the lengths),
    ``force_delay_1`` … and ``length_delay_1`` … (s: a channel lags behind its stamps),
    ``force_low_pass_1`` … and ``length_low_pass_1`` … (s: time constant of a first-order low pass,
    at least 0), ``clock`` (a share: stamps run fast).
    """
    entries = _entries(robot, robot.description.tolerances or RobotTolerances())
    return tuple(
        Deviation(
            name,
            group,
            unit,
            float(tolerance or 0.0),
            lower=0.0 if group in LOW_PASSES.values() else -np.inf,
        )
        for name, group, unit, tolerance in entries
    )


def toleranced_deviations(robot: Robot) -> tuple[Deviation, ...]:
    """Return the entries of θ with a tolerance."""
    return tuple(each for each in deviations(robot) if each.tolerance > 0)


def low_passes(robot: Robot) -> tuple[Deviation, ...]:
    """Return the time constants of low passes with a tolerance."""
    groups = LOW_PASSES.values()
    return tuple(each for each in toleranced_deviations(robot) if each.group in groups)


def estimated_constants(robot: Robot) -> tuple[Deviation, ...]:
    """Return the constants of terms that the robot file marks for estimation.

    Their standard deviation is their tolerance, infinite without one: only the start of the search
    is known. A positive constant stays above a tenth of its start.
    """
    about = robot.description
    flagged = {f"terms.{name}" for name in about.estimated_constants}
    if not flagged:
        return ()
    values = iter(about.constants)
    least = {
        f"terms.{term.name}.{constant.name}": -_MOST_OFF * value if constant.positive else -np.inf
        for term in robot.terms
        for constant, value in zip(term.constants, values, strict=False)
    }
    return tuple(
        replace(one, tolerance=one.tolerance or np.inf, lower=least[one.group])
        for one in deviations(robot)
        if one.group in flagged
    )


def _entries(robot: Robot, given: RobotTolerances) -> Iterator[tuple[str, str, str, float | None]]:
    for group in ("base_joints", "platform_joints"):
        std = getattr(given, group) or ((0.0,) * len(_AXES),) * ACTUATORS
        for name, row in zip(actuator_names(f"{group[:-1]}_"), std, strict=True):
            for axis, value in zip(_AXES, row, strict=True):
                yield f"{name}_{axis}", group, "m", value
    for name in ("gravity_1", "gravity_2"):
        yield name, "gravity", "rad", given.gravity
    for term in robot.terms:
        own = (given.terms or {}).get(term.name, {})
        for constant in term.constants:
            group = f"terms.{term.name}.{constant.name}"
            yield f"{term.name}_{constant.name}", group, constant.unit, own.get(constant.name)
    for term in _lacking_terms(robot):
        own = (given.terms or {})[term.name]
        for one in term.parameters:
            std = own.get(one.name, own.get(EACH_PARAMETER))
            yield f"{term.name}_{one.name}", f"terms.{term.name}", one.unit, std
    forces = given.force_constant or ForceConstantTolerance()
    if robot.description.forces_of_voltages and given.motor is not None:
        forces = ForceConstantTolerance()  # it would count twice
    yield from _numbered_entries("strut_length", "strut_length", "m", given.strut_length)
    yield FORCE_CONSTANT, "force_constant.common", "1", forces.common
    yield from _numbered_entries(FORCE_CONSTANT, "force_constant.each", "1", forces.each)
    for name in MOTOR_EFFECTS if robot.description.forces_of_voltages else ():
        shares = getattr(given.motor or MotorTolerance(), name) or ForceConstantTolerance()
        yield f"motor_{name}", f"motor.{name}.common", "1", shares.common
        yield from _numbered_entries(f"motor_{name}", f"motor.{name}.each", "1", shares.each)
    yield "delay", "delay", "s", given.delay
    late = given.channel_delay or ChannelTimeTolerance()
    yield from _numbered_entries("force_delay", CHANNEL_DELAYS["Q"], "s", late.forces)
    yield from _numbered_entries("length_delay", CHANNEL_DELAYS["q"], "s", late.lengths)
    slow = given.low_pass or ChannelTimeTolerance()
    yield from _numbered_entries("force_low_pass", LOW_PASSES["Q"], "s", slow.forces)
    yield from _numbered_entries("length_low_pass", LOW_PASSES["q"], "s", slow.lengths)
    yield "clock", "clock", "1", given.clock


def _lacking_terms(robot: Robot) -> tuple[Term, ...]:
    """Return the terms that the robot lacks and whose parameters have a tolerance."""
    lacking = robot.extended.terms[len(robot.terms) :]
    return tuple(term for term in lacking if term.name != BACK_EMF.name)


def _numbered_entries(
    name: str, group: str, unit: str, values: Sequence[float] | None
) -> Iterator[tuple[str, str, str, float]]:
    std = [0.0] * ACTUATORS if values is None else values
    for one, value in zip(actuator_names(f"{name}_"), std, strict=True):
        yield one, group, unit, value


def tilt_axes(gravity: Array) -> Array:
    """Return the two axes of rotation of gravity's direction, (2, 3), unit vectors.

    They are across it, in the base frame: x and y for a base that lies level. Zeros without
    gravity.
    """
    size = float(np.linalg.norm(gravity))
    if size == 0:
        return np.zeros((TILTS, 3))
    up = -gravity / size
    # The same axes for gravity a little turned: nothing that depends on the smallest component.
    start = np.eye(3)[0 if abs(up[0]) < _ALONG else 1]
    first = start - (start @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def apply_deviations(robot: Robot, chosen: Sequence[Deviation], values: Array) -> Robot:
    """Return the robot with deviations θ of joints, gravity, constants and lacking terms.

    `values` is θ of the chosen deviations, (t,), SI. Errors of the measurement among them do not
    change the robot. Its cardan axes keep their directions.
    """
    about = robot.description
    theta = np.zeros(len(deviations(robot)))
    np.add.at(theta, _places(robot, chosen), values)
    further = len(parameters_of(_lacking_terms(robot)))
    ends = np.cumsum([JOINT_ENTRIES, JOINT_ENTRIES, TILTS, len(about.constants), further])
    base, platform, tilts, constants, lacking, _ = np.split(theta, ends)
    turn = tilts @ tilt_axes(about.gravity)
    angle = float(np.linalg.norm(turn))
    gravity = about.gravity
    if angle:
        axis = turn / angle  # across gravity: Rodrigues' formula without its part along the axis
        gravity = np.cos(angle) * gravity + np.sin(angle) * np.cross(axis, gravity)
    moved = replace(
        about,
        base_joints=read_only(about.base_joints + base.reshape(ACTUATORS, -1)),
        platform_joints=read_only(about.platform_joints + platform.reshape(ACTUATORS, -1)),
        gravity=read_only(gravity),
        constants=tuple((np.array(about.constants) + constants).tolist()),
    )
    return replace(robot, description=moved, lacking_parameters=tuple(lacking.tolist()))


def as_in_a_file(robot: ResolvedRobot) -> RobotDescription:
    """Return the robot file's description of a robot with deviations."""
    known, about = robot.constants_by_term, robot.description
    terms = tuple(term.with_constants(known[term.name]) for term in about.terms)
    names = ("base_joints", "platform_joints")
    joints = {name: tuple(map(tuple, getattr(robot, name).tolist())) for name in names}
    gravity = tuple(robot.gravity.tolist())
    return about.model_copy(update=joints | {"gravity": gravity, "terms": terms})


_STATE = 3 * COORDINATES


@kernel
def _force_kernel(terms: tuple[Term, ...], friction: Friction) -> Graph:
    """State (18), signs (s) if held → A (6, m), ∂(A p)/∂state (6, 18), ∂/∂machine (6, 39 + c)."""
    graph = hexapod_graph(terms)
    regressor, geometry = graph.regressor_with(friction), graph.geometry
    joints = (ca.vec(geometry.base_joints), ca.vec(geometry.platform_joints))
    machine = ca.vertcat(*joints, geometry.gravity, graph.constants)
    slopes = [graph.force_slope(friction, by) for by in (graph.state, machine)]
    inputs = [graph.machine, graph.parameters]
    varying = [graph.state, graph.signs] if friction is Friction.HELD else [graph.state]
    return Graph("deviating_force", varying, inputs, [regressor, *slopes])


@kernel
def _length_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → length rates (6) and ∂l/∂(A, b), (6, 36)."""
    graph = hexapod_graph(terms)
    geometry = graph.geometry
    joints = ca.vertcat(ca.vec(geometry.base_joints), ca.vec(geometry.platform_joints))
    outputs = [
        graph.kinematic["strut_speed"],
        ca.densify(ca.jacobian(graph.kinematic["strut_length"], joints)),
    ]
    return Graph("deviating_length", [graph.state], [geometry.vector], outputs)


@kernel
def _jump_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → ∂(A p)/∂signs (6, s), the rates of dry friction (s) and their rates (s)."""
    graph = hexapod_graph(terms)
    force = graph.regressor_with(Friction.HELD) @ graph.parameters
    moving = ca.vertcat(graph.pose, graph.rate)
    changing = ca.vertcat(graph.rate, graph.acceleration)
    outputs = [
        ca.densify(ca.jacobian(force, graph.signs)),
        ca.densify(graph.sliding),
        ca.densify(ca.jacobian(graph.sliding, moving) @ changing),
    ]
    inputs = [graph.machine, graph.parameters]
    return Graph("jumping_force", [graph.state, graph.signs], inputs, outputs)


def force_jumps(
    robot: Robot, state: Array, signs: Array, parameters: Array
) -> tuple[Array, Array, Array]:
    """Return ∂(A p)/∂signs, (S, 6, s), the rates of dry friction and their derivatives, (S, s).

    States are (S, 18) or more, signs (S, s), s ≥ 1.
    """
    kernel = _jump_kernel(robot.terms)
    jumps, rate, change = kernel(state[:, :_STATE], signs, robot.machine, parameters)
    return jumps, rate, change


def exact_signs(robot: Robot, state: Array) -> Array:
    """Return the signs of the rates that the terms use, (S, s), at states (S, 18) or more."""
    count = robot.graph.signs.shape[0]
    nothing = np.zeros((len(state), count))
    if not count:
        return nothing
    return np.sign(force_jumps(robot, state, nothing, robot.parameters)[1])


def delay_of_jumps(
    robot: Robot, state: Array, signs: Array, parameters: Array, step: float
) -> Array:
    """Return the share of the jumps of dry friction in the column of a delay, (S, 6), N/s.

    A delay moves every reversal: close to it the friction has the other sign for that time. Each
    jump is spread over one step between the samples, s, which is right on average over the
    positions of the samples. States are (S, 24), signs (S, s).
    """
    if not signs.shape[1]:
        return np.zeros((len(state), ACTUATORS))
    slope, rate, change = force_jumps(robot, state, signs, parameters)
    near = np.abs(rate) < np.abs(change) * step / 2
    return -np.einsum("sij,sj->si", slope, np.where(near, 2 * np.sign(change) / step, 0.0))


def add_jumps(columns: Array, chosen: Sequence[Deviation], jumps: Array) -> None:
    """Add the share of `delay_of_jumps`, (S, 6), to the columns of delays of forces, (S, 6, t)."""
    for place, one in enumerate(chosen):
        if one.group == "delay":
            columns[:, :, place] += jumps
        elif one.group in LAGS_OF_FORCES:
            columns[:, one.channel, place] += jumps[:, one.channel]


class DeviatingForces(NamedTuple):
    """Forces of a motion with their derivatives."""

    forces: Array
    """(S, 6), A p and the forces of the robot's `lacking_parameters`, N."""
    regressors: Array
    """(S, 6, m), A with the given signs of friction."""
    state_slope: Array
    """(S, 6, 18), ∂(forces)/∂(λ, λ̇, λ̈)."""
    columns: Array
    """(S, 6, t), Z_f = ∂(measured forces)/∂θ, N per SI unit of each entry."""


def deviating_forces(
    robot: Robot,
    state: Array,
    times: Array,
    signs: Array | None,
    parameters: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> DeviatingForces:
    """Return the forces of a motion and their derivatives to deviations of the machine.

    The motion of the platform, the parameters and the signs of friction are held.

    Parameters
    ----------
    state : (S, 24)
        λ and its first three derivatives with respect to time.
    times : (S,)
        Stamps, s.
    signs : (S, s) or None
        Of the rates that the terms use; None: the exact ones of this motion.
    own_clock : bool
        True if the motion's frequency comes from the recording itself, in its own clock; else it
        is that of the controller, and the stamps deviate from it.
    """
    extended, own = robot.extended, len(parameters)
    kernel = _force_kernel(extended.terms, Friction.EXACT if signs is None else Friction.HELD)
    varying = [state[:, :_STATE]]
    if signs is not None:
        lacking_rates = extended.graph.signs.shape[0] - signs.shape[1]
        if lacking_rates:  # of lacking terms alone
            further = exact_signs(extended, state)[:, -lacking_rates:]
            signs = np.concatenate([signs, further], axis=1)
        varying.append(signs)
    values = np.concatenate([parameters, extended.parameters[own:]])
    regressors, by_state, by_machine = kernel(*varying, extended.machine, values)
    forces = regressors @ values
    tilting = np.cross(tilt_axes(robot.description.gravity), robot.description.gravity)
    joints, constants = 2 * JOINT_ENTRIES, len(robot.description.constants)
    by_gravity = by_machine[:, :, joints : joints + 3] @ tilting.T
    rate = np.einsum("sji,si->sj", by_state, state[:, COORDINATES:])
    if own_clock:
        # A clock that runs fast makes rates look too small, and accelerations twice as much.
        faster = np.repeat([0, 1, 2], COORDINATES) * state[:, :_STATE]
        clock = np.einsum("sji,si->sj", by_state, faster)
    else:
        clock = -times[:, None] * rate
    of_channels = -rate[:, :, None] * np.eye(ACTUATORS)
    nothing = np.zeros_like(of_channels)
    blocks = [
        by_machine[:, :, :joints],
        by_gravity,
        by_machine[:, :, joints + 3 : joints + 3 + constants],
        regressors[:, :, own : own + len(parameters_of(_lacking_terms(robot)))],
        nothing,
        forces[:, :, None],
        forces[:, :, None] * np.eye(ACTUATORS),
        *_motor_columns(robot, forces, regressors, values),
        -rate[:, :, None],
        *(of_channels, nothing),
        *(of_channels, nothing),  # a small time constant is a delay
        clock[:, :, None],
    ]
    columns = np.concatenate(blocks, axis=2)[:, :, _places(robot, chosen)]
    return DeviatingForces(forces, regressors[:, :, :own], by_state, columns)


def _motor_columns(robot: Robot, forces: Array, regressors: Array, values: Array) -> list[Array]:
    """Return the columns of the motors' constants, for forces of voltages, (S, 6, 1 or 6) each."""
    if not robot.description.forces_of_voltages:
        return []
    names = robot.extended.parameter_names
    own = [names.index(one.name) for one in BACK_EMF.parameters]
    damping = regressors[:, :, own] @ values[own]
    changes = [gain * forces + share * damping for gain, share in MOTOR_EFFECTS.values()]
    return [change[:, :, None] * of for change in changes for of in (1.0, np.eye(ACTUATORS))]


def length_deviation_columns(
    robot: Robot,
    state: Array,
    times: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> Array:
    """Return Z_l = ∂(measured lengths)/∂θ, (S, 6, t), in m per SI unit of each entry.

    As `deviating_forces`; the state's third derivative is not used.
    """
    kernel = _length_kernel(kinematic_terms(robot.terms))
    rate, by_joints = kernel(state[:, :_STATE], robot.geometry_vector)
    samples, lacking = (len(state), ACTUATORS), parameters_of(_lacking_terms(robot))
    others = TILTS + len(robot.description.constants) + len(lacking)
    motors = len(MOTOR_EFFECTS) * robot.description.forces_of_voltages
    clock = np.zeros(samples) if own_clock else -times[:, None] * rate
    of_channels = -rate[:, :, None] * np.eye(ACTUATORS)
    blocks = [
        by_joints,
        np.zeros((*samples, others)),
        np.broadcast_to(np.eye(ACTUATORS), (*samples, ACTUATORS)),
        np.zeros((*samples, (1 + motors) * (1 + ACTUATORS) + 1 + ACTUATORS)),
        *(of_channels, np.zeros_like(of_channels), of_channels),
        clock[:, :, None],
    ]
    return np.concatenate(blocks, axis=2)[:, :, _places(robot, chosen)]


def _places(robot: Robot, chosen: Sequence[Deviation]) -> list[int]:
    """Return the indices of some entries among all of the robot."""
    given = robot.description.tolerances or RobotTolerances()
    places = {name: place for place, (name, *_) in enumerate(_entries(robot, given))}
    return [places[each.name] for each in chosen]
