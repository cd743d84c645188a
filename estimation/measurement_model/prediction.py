"""Predicted lengths and forces along a motion, with their derivatives to ξ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from constraints.arrays import Array
from estimation.measurement_model.motion import HarmonicMotion, MotionColumns, MotionSamples
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, deviating_forces, length_deviation_columns

_CHUNK = 2048


def chunks(count: int) -> list[slice]:
    """Return the samples in parts whose derivatives fit into memory together."""
    return [slice(first, first + _CHUNK) for first in range(0, count, _CHUNK)]


@kernel
def force_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18), signs (s) → regressor A (6, m) and ∂(A p)/∂state (6, 18), signs held."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.HELD)
    slope = graph.force_slope(Friction.HELD, graph.state)
    return Graph(
        "force_sensitivity",
        [graph.state, graph.signs],
        [graph.machine, graph.parameters],
        [regressor, slope],
    )


@kernel
def held_regressor_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18), signs (s) → regressor A (6, m) with the signs given."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.HELD)
    return Graph("held_regressor", [graph.state, graph.signs], [graph.machine], [regressor])


@kernel
def sliding_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → the rates (s) of dry friction and their slope to λ, λ̇ (s, 12)."""
    graph = hexapod_graph(terms)
    moving = ca.vertcat(graph.pose, graph.rate)
    slope = ca.jacobian(graph.sliding, moving)
    return Graph("sliding", [graph.state], [graph.geometry.vector], [graph.sliding, slope])


@kernel
def sliding_rate_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → the rates (s) of dry friction."""
    graph = hexapod_graph(terms)
    return Graph("sliding_rate", [graph.state], [graph.geometry.vector], [graph.sliding])


def predict_lengths(robot: Robot, motion: HarmonicMotion, times: Array) -> tuple[Array, Array]:
    """Return strut lengths at the times given, (S, 6), m, and their slope to ξ, (S, 6, x)."""
    lengths, columns = length_columns(robot, motion.at(times))
    return lengths, columns.dense()


def length_columns(robot: Robot, sampled: MotionSamples) -> tuple[Array, MotionColumns]:
    """Return strut lengths, (S, 6), m, and the columns of ξ in them."""
    lengths, jacobian = robot.lengths_and_jacobian(sampled.pose())
    return lengths, MotionColumns(jacobian[:, :, :0], jacobian, sampled)


class ForcePrediction(NamedTuple):
    """Actuator forces along a motion, linear in the parameters.

    Attributes
    ----------
    regressors : (S, 6, m)
        A with the friction signs given.
    slope : (S, 6, x)
        ∂(A p)/∂ξ at the parameters given, signs held.
    """

    regressors: Array
    slope: Array


def predict_forces(
    robot: Robot, motion: HarmonicMotion, times: Array, signs: Array, parameters: Array
) -> ForcePrediction:
    """Return A at the times given, s, and the slope of A p to ξ.

    `signs` are those of the rates that the terms use, (S, s); parameters, (m,), are in SI.
    """
    sampled, kernel = motion.at(times), force_kernel(robot.terms)
    regressors, slope = kernel(sampled.state(), signs, robot.machine, parameters)
    return ForcePrediction(regressors, sampled.chain(slope))


def deviation_forces(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    signs: Array,
    values: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> Array:
    """Return Z_f, (S, 6, t), in N per SI unit of each entry.

    Parameters
    ----------
    times : (S,)
        Of the forces, s.
    signs : (S, s)
        Of friction, as of `Experiment.signs`: held.
    values : (m,)
        Parameters, SI.
    chosen : sequence of Deviation
        The columns wanted.
    own_clock : bool
        ω was taken from the recording itself, not from a design (`deviating_forces`).
    """
    parts = [np.empty((0, ACTUATORS, len(chosen)))]
    for part in chunks(len(times)):
        state = state_with_jerk(motion.at(times[part]))
        found = deviating_forces(
            robot, state, times[part], signs[part], values, chosen, own_clock=own_clock
        )
        parts.append(found.columns)
    return np.concatenate(parts)


def deviation_lengths(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> Array:
    """Return Z_l, (S, 6, t), in m per SI unit of each entry; `times` are those of the lengths."""
    parts = [np.empty((0, ACTUATORS, len(chosen)))]
    for part in chunks(len(times)):
        state = state_with_jerk(motion.at(times[part]))
        parts.append(
            length_deviation_columns(robot, state, times[part], chosen, own_clock=own_clock)
        )
    return np.concatenate(parts)


def state_with_jerk(sampled: MotionSamples) -> Array:
    """Return λ and its first three derivatives, (S, 24)."""
    return np.concatenate([sampled.state(), sampled.state(first=1)[:, 2 * COORDINATES :]], axis=1)
