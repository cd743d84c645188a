"""Derivatives of lengths and forces to the machine's deviations: columns ∂/∂θ along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term, kinematic_terms
from expdesign.robot.deviation import JOINT_ENTRIES, Deviation, tilt_axes
from expdesign.robot.robot import Robot

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
    moving, changing = (
        ca.vertcat(graph.pose, graph.rate),
        ca.vertcat(graph.rate, graph.acceleration),
    )
    outputs = [
        ca.densify(ca.jacobian(force, graph.signs)),
        ca.densify(graph.sliding),
        ca.densify(ca.jacobian(graph.sliding, moving) @ changing),
    ]
    inputs = [graph.machine, graph.parameters]
    return Graph("jumping_force", [graph.state, graph.signs], inputs, outputs)


def exact_signs(robot: Robot, state: Array) -> Array:
    """Return the signs of the rates that the terms use, (S, s), at states (S, 18) or more."""
    count = robot.graph.signs.shape[0]
    nothing = np.zeros((len(state), count))
    if not count:
        return nothing
    kernel = _jump_kernel(robot.terms)
    _, rate, _ = kernel(state[:, :_STATE], nothing, robot.machine, robot.parameters)
    return np.sign(rate)


def delay_of_jumps(
    robot: Robot, state: Array, signs: Array, parameters: Array, step: float
) -> Array:
    """Return what dry friction adds to the column of a delay, (S, 6), N/s, where it jumps.

    A delay moves every reversal: next to it the friction has the other sign for that time. Each
    jump is spread over one step between the samples, s, which is right on the average over where
    the samples happen to be.

    Parameters
    ----------
    state : (S, 24)
        As of `deviating_forces`.
    signs : (S, s)
        In which the forces are linear, or nearly.
    """
    if not signs.shape[1]:
        return np.zeros((len(state), ACTUATORS))
    kernel = _jump_kernel(robot.terms)
    slope, rate, change = kernel(state[:, :_STATE], signs, robot.machine, parameters)
    near = np.abs(rate) < np.abs(change) * step / 2
    return -np.einsum("sij,sj->si", slope, np.where(near, 2 * np.sign(change) / step, 0.0))


class DeviatingForces(NamedTuple):
    """Forces of a motion, and what moves them.

    Attributes
    ----------
    regressors : (S, 6, m)
        A with the friction signs given.
    state_slope : (S, 6, 18)
        ∂(A p)/∂(λ, λ̇, λ̈).
    columns : (S, 6, t)
        Z_f = ∂(measured forces)/∂θ, in N per SI unit of each entry.
    """

    regressors: Array
    state_slope: Array
    columns: Array


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
    """Return the forces of a motion and how deviations of the machine move what is measured.

    The motion of the platform, the parameters and the signs of friction are held.

    Parameters
    ----------
    state : (S, 24)
        λ and its first three derivatives with respect to time.
    times : (S,)
        Stamps, s.
    signs : (S, s) or None
        Of the rates that the terms use; None: the exact ones of this motion.
    parameters : (m,)
        SI.
    chosen : sequence of Deviation
        The columns wanted, of this robot.
    own_clock : bool
        The motion's frequency was taken from the recording itself, in its own clock. Else it is
        that of the controller, which is right, and stamps run away from it.
    """
    kernel = _force_kernel(robot.terms, Friction.EXACT if signs is None else Friction.HELD)
    varying = [state[:, :_STATE], *([] if signs is None else [signs])]
    regressors, by_state, by_machine = kernel(*varying, robot.machine, parameters)
    forces = regressors @ parameters
    tilting = np.cross(tilt_axes(robot.description.gravity), robot.description.gravity)
    joints = 2 * JOINT_ENTRIES
    by_gravity = by_machine[:, :, joints : joints + 3] @ tilting.T
    rate = np.einsum("sji,si->sj", by_state, state[:, COORDINATES:])
    if own_clock:
        # A clock that runs fast makes rates look too small, and accelerations twice as much.
        faster = np.concatenate(
            [
                order * state[:, order * COORDINATES : (order + 1) * COORDINATES]
                for order in (0, 1, 2)
            ],
            axis=1,
        )
        clock = np.einsum("sji,si->sj", by_state, faster)
    else:
        clock = -times[:, None] * rate
    blocks = [
        by_machine[:, :, :joints],
        by_gravity,
        by_machine[:, :, joints + 3 :],
        np.zeros((len(forces), ACTUATORS, ACTUATORS)),
        forces[:, :, None],
        forces[:, :, None] * np.eye(ACTUATORS),
        -rate[:, :, None],
        clock[:, :, None],
    ]
    return DeviatingForces(regressors, by_state, _pick_columns(blocks, chosen))


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
    samples = (len(state), ACTUATORS)
    clock = np.zeros(samples) if own_clock else -times[:, None] * rate
    blocks = [
        by_joints,
        np.zeros((*samples, _other_entries(robot))),
        np.broadcast_to(np.eye(ACTUATORS), (*samples, ACTUATORS)),
        np.zeros((*samples, 1 + ACTUATORS + 1)),
        clock[:, :, None],
    ]
    return _pick_columns(blocks, chosen)


def _other_entries(robot: Robot) -> int:
    """Return how many entries of gravity and of the terms there are."""
    return len(tilt_axes(robot.description.gravity)) + len(robot.description.constants)


def _pick_columns(blocks: Sequence[Array], chosen: Sequence[Deviation]) -> Array:
    places = [each.place for each in chosen]
    return np.concatenate(blocks, axis=2)[:, :, places]
