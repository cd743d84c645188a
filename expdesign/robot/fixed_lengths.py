"""Columns of the deviations θ of a machine at fixed lengths of its struts.

The lengths of an experiment are measured almost exactly. A deviation θ therefore changes the pose
that they imply, by δλ = −J⁻¹ Z_l θ with J = ∂l/∂λ, and the forces at these lengths by

    Z = Z_f − ∂(A p)/∂λ W − ∂(A p)/∂λ̇ Ẇ − ∂(A p)/∂λ̈ Ẅ,    W = J⁻¹ Z_l,

a function of the state alone: [A | Z] is a regressor with more columns. The signs of dry friction
are held. `fixed_length_graph` states Z symbolically, for a search; `fixed_length_columns` computes
it from the motion as a whole, with Ẇ and Ẅ from the Fourier series of W, for reported values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph, inverse
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term, parameters_of
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.robot.deviation import (
    CHANNEL_DELAYS,
    LOW_PASSES,
    MOTOR_EFFECTS,
    MOTOR_GROUPS,
    Deviation,
    deviating_forces,
    deviations,
    length_deviation_columns,
    tilt_axes,
)
from expdesign.robot.robot import Robot

_GROUPS = {
    "base_joints": "joints",
    "platform_joints": "joints",
    "gravity": "gravity",
    "strut_length": "strut_length",
    "force_constant.common": "force_constant",
    "force_constant.each": "force_constant",
    **dict.fromkeys(MOTOR_GROUPS, "motor"),
    "delay": "delay",
    CHANNEL_DELAYS["Q"]: "force_delay",
    CHANNEL_DELAYS["q"]: "length_delay",
    LOW_PASSES["Q"]: "force_delay",
    LOW_PASSES["q"]: "length_delay",
    "clock": "clock",
}


class DeviationGroups(NamedTuple):
    """Symbolic columns of Z: of complete groups, in `_GROUPS`' order, constants and terms last."""

    terms: tuple[Term, ...]
    """Of the robot, then those that it lacks and whose parameters have a tolerance."""
    own: int
    """Number of parameters of the robot's terms."""
    groups: tuple[str, ...]

    @classmethod
    def of(cls, robot: Robot, chosen: Sequence[Deviation]) -> DeviationGroups:
        """Return the groups that contain the chosen deviations."""
        groups = dict.fromkeys((*_GROUPS.values(), "constants", "lacking"))
        used = {_group(robot, one) for one in chosen}
        kept = tuple(group for group in groups if group in used)
        return cls(robot.extended.terms, len(robot.parameters), kept)

    @property
    def has_jerk(self) -> bool:
        """Whether Z depends on the third derivative of the motion: that of a delay does."""
        return bool({"delay", "force_delay", "length_delay"} & {*self.groups})


def _group(robot: Robot, one: Deviation) -> str:
    if one.group in _GROUPS:
        return _GROUPS[one.group]
    own = {f"terms.{term.name}.{c.name}" for term in robot.terms for c in term.constants}
    return "constants" if one.group in own else "lacking"


def fixed_length_graph(about: DeviationGroups) -> tuple[HexapodGraph, ca.SX, ca.SX]:
    """Return the graph, its state, and [A | Z], (6, m + t), with smoothed signs of friction.

    The state is (18), or (24) with the third derivative. The inputs of the columns are also
    machine, parameters and width of the graph. The columns of gravity are those of its vector.
    """
    graph, groups = hexapod_graph(about.terms), about.groups
    jerk = ca.SX.sym("jerk", COORDINATES if about.has_jerk else 0)
    slopes = [
        graph.force_slope(Friction.HELD, by) for by in (graph.pose, graph.rate, graph.acceleration)
    ]
    geometry, force = graph.geometry, graph.force_with(Friction.HELD)
    joints = ca.vertcat(ca.vec(geometry.base_joints), ca.vec(geometry.platform_joints))
    of_lengths = {"joints", "strut_length", "length_delay"} & {*groups}
    by_length = _length_slopes(graph, slopes) if of_lengths else []
    columns = [graph.regressor[:, : about.own]]
    for group in groups:
        if group == "joints":
            lengths = ca.jacobian(graph.kinematic["strut_length"], joints)
            rates = _rate_of(graph, lengths)
            moved = (lengths, rates, _rate_of(graph, rates))
            columns.append(graph.force_slope(Friction.HELD, joints) - _sum(by_length, moved))
        elif group == "gravity":
            columns.append(graph.force_slope(Friction.HELD, geometry.gravity))
        elif group == "constants":
            columns.append(graph.force_slope(Friction.HELD, graph.constants))
        elif group == "lacking":
            known = about.terms[-1].name == BACK_EMF.name
            columns.append(graph.regressor[:, about.own : -ACTUATORS if known else None])
        elif group == "strut_length":
            columns.append(-by_length[0])
        elif group == "force_constant":
            columns.append(ca.diag(force))
        elif group == "motor":
            names = [one.name for one in parameters_of(about.terms)]
            own = [names.index(one.name) for one in BACK_EMF.parameters]
            damping = graph.regressor[:, own] @ graph.parameters[own]
            columns.append(ca.horzcat(ca.diag(force), ca.diag(damping)))
        elif group in ("delay", "force_delay"):
            change = -_sum(slopes, (graph.rate, graph.acceleration, jerk))
            columns.append(change if group == "delay" else ca.diag(change))
        elif group == "length_delay":
            speed = graph.kinematic["strut_speed"]
            moving = ca.vertcat(graph.pose, graph.rate, graph.acceleration)
            changing = ca.vertcat(graph.rate, graph.acceleration, jerk)
            acceleration = _rate_of(graph, speed)
            moved = (speed, acceleration, ca.jtimes(acceleration, moving, changing))
            columns.append(_sum(by_length, tuple(map(ca.diag, moved))))
        else:  # a clock that runs fast makes rates look too small, and accelerations twice as much
            columns.append(slopes[1] @ graph.rate + 2 * (slopes[2] @ graph.acceleration))
    smooth = graph.with_signs(ca.horzcat(*columns), Friction.SMOOTH)
    return graph, ca.vertcat(graph.state, jerk), ca.cse(ca.densify(smooth))


def _length_slopes(graph: HexapodGraph, slopes: Sequence[ca.SX]) -> list[ca.SX]:
    """Return derivatives of the forces to the lengths and their first two rates, (6, 6) each.

    J W = Z_l gives J Ẇ = Ż_l − J̇ W and J Ẅ = Z̈_l − 2 J̇ Ẇ − J̈ W.
    """
    turning = ca.jacobian(graph.kinematic["platform_rate"][3:], graph.rate[3:])
    to_rates = ca.diagcat(ca.SX.eye(3), inverse(turning))
    inverse_jacobian = to_rates @ graph.inverse_jacobian_transposed.T
    first = _rate_of(graph, ca.jacobian(graph.kinematic["strut_length"], graph.pose))
    by_acceleration = slopes[2] @ inverse_jacobian
    by_rate = (slopes[1] - 2 * by_acceleration @ first) @ inverse_jacobian
    second = by_acceleration @ _rate_of(graph, first)
    return [
        (slopes[0] - by_rate @ first - second) @ inverse_jacobian,
        by_rate,
        by_acceleration,
    ]


def _sum(slopes: Sequence[ca.SX], changes: Sequence[ca.SX]) -> ca.SX:
    found = ca.SX.zeros(ACTUATORS, changes[0].shape[1])
    for slope, change in zip(slopes, changes, strict=True):
        found += slope @ change
    return found


def _rate_of(graph: HexapodGraph, value: ca.SX) -> ca.SX:
    """Return the derivative of an expression of pose and rate with respect to time."""
    moving = ca.vertcat(graph.pose, graph.rate)
    return ca.jtimes(value, moving, ca.vertcat(graph.rate, graph.acceleration))


def group_effects(robot: Robot, chosen: Sequence[Deviation]) -> Array:
    """Return the effect of one standard deviation of each on the columns' unknowns, (n, t), SI.

    The columns are those of `fixed_length_graph`.
    """
    gravity = robot.description.gravity
    every = deviations(robot)
    names = [one.name for one in every]
    groups = [_group(robot, one) for one in every]
    blocks = {group: np.eye(groups.count(group)) for group in dict.fromkeys(groups)}
    blocks["gravity"] = np.cross(tilt_axes(gravity), gravity).T
    blocks["force_constant"] = np.concatenate([np.ones((ACTUATORS, 1)), np.eye(ACTUATORS)], axis=1)
    # Of the forces, then of the damping in them.
    of_both = [
        np.kron(np.array([[a], [b]]), blocks["force_constant"]) for a, b in MOTOR_EFFECTS.values()
    ]
    blocks["motor"] = np.concatenate(of_both, axis=1)
    for group in ("force_delay", "length_delay"):
        blocks[group] = np.tile(np.eye(ACTUATORS), 2)  # a small time constant is a delay
    about = DeviationGroups.of(robot, chosen)
    rows = [len(blocks[group]) for group in about.groups]
    found = np.zeros((sum(rows), len(chosen)))
    for column, one in enumerate(chosen):
        group, place = groups[names.index(one.name)], names.index(one.name)
        own = groups[:place].count(group)
        number = about.groups.index(group)
        first = sum(rows[:number])
        block = blocks[group][:, own]
        found[first : first + rows[number], column] = block * one.tolerance
    return found


def fixed_length_columns(
    robot: Robot, motion: tuple[Array, Array, Array], omega: float, chosen: Sequence[Deviation]
) -> Array:
    """Return Z of some deviations at the samples of one period, (N, 6, t), N per SI unit.

    It is evaluated at the nominal parameters, with exact signs of friction, which are held. Some
    200 samples resolve the derivatives of W for five harmonics.

    Parameters
    ----------
    motion : pose, rate and acceleration
        λ, λ̇, λ̈ at equal times of one period, (N, 6) each: m, rad, s.
    omega : float
        rad/s.
    chosen : sequence of Deviation
    """
    times = 2 * np.pi / omega * np.arange(len(motion[0])) / len(motion[0])
    state = np.concatenate([*motion, _time_derivative(motion[2], omega, 1)], axis=1)
    lengths = length_deviation_columns(robot, state, times, chosen, own_clock=True)
    moved = np.asarray(np.linalg.solve(robot.length_jacobian(motion[0]), lengths), np.float64)
    forces = deviating_forces(robot, state, times, None, robot.parameters, chosen, own_clock=True)
    found = forces.columns
    for order in range(3):
        slope = forces.state_slope[:, :, COORDINATES * order : COORDINATES * (order + 1)]
        found = found - np.matmul(slope, _time_derivative(moved, omega, order))
    return found


def _time_derivative(values: Array, omega: float, order: int) -> Array:
    """Return a derivative of a periodic function at equal times of one period, (N, …)."""
    if order == 0:
        return values
    count = len(values)
    lines = np.fft.rfft(values, axis=0)
    if count % 2 == 0:
        lines[-1] = 0.0  # the highest line of an even number has no phase
    factor = (1j * omega * np.arange(len(lines))) ** order
    return np.fft.irfft(lines * factor.reshape(-1, *(1,) * (values.ndim - 1)), count, axis=0)
