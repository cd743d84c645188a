"""Lengths and forces along a motion: kernels, and columns of ξ."""

from __future__ import annotations

import casadi as ca
import numpy as np

from constraints.arrays import Array
from estimation.measurement_model.motion import MotionColumns, Samples
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.robot import Robot

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
def sliding_change_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → the rates (s) of dry friction and their derivatives to the time (s)."""
    graph = hexapod_graph(terms)
    moving = ca.vertcat(graph.pose, graph.rate)
    changes = ca.jtimes(graph.sliding, moving, ca.vertcat(graph.rate, graph.acceleration))
    return Graph("sliding_change", [graph.state], [graph.geometry.vector], [graph.sliding, changes])


@kernel
def sliding_rate_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → the rates (s) of dry friction."""
    graph = hexapod_graph(terms)
    return Graph("sliding_rate", [graph.state], [graph.geometry.vector], [graph.sliding])


def length_columns(robot: Robot, sampled: Samples) -> tuple[Array, MotionColumns]:
    """Return strut lengths, (S, 6), m, and the columns of ξ in them."""
    lengths, jacobian = robot.lengths_and_jacobian(sampled.pose())
    return lengths, MotionColumns(jacobian[:, :, :0], jacobian, sampled)


def state_with_jerk(sampled: Samples) -> Array:
    """Return λ and its first three derivatives, (S, 24)."""
    return np.concatenate([sampled.state(), sampled.state(first=1)[:, 2 * COORDINATES :]], axis=1)
