"""Functions of the shared symbolic graph that only estimation needs: derivatives to the state."""

from __future__ import annotations

from functools import cache

import casadi as ca

from expdesign.mechanism.graph import Friction, hexapod_graph
from expdesign.mechanism.term import Term
from expdesign.robot.batch import BatchFunction


@cache
def force_kernel(terms: tuple[Term, ...]) -> BatchFunction:
    """State (18), signs (s) → regressor A (6, m) and ∂(A p)/∂state (6, 18), signs held."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.HELD)
    slope = ca.jacobian(regressor @ graph.parameters, graph.state)
    return BatchFunction(
        "force_sensitivity",
        [graph.state, graph.signs],
        [graph.machine.vector, graph.parameters],
        [regressor, slope],
    )


@cache
def held_regressor_kernel(terms: tuple[Term, ...]) -> BatchFunction:
    """State (18), signs (s) → regressor A (6, m) with the signs given."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.HELD)
    return BatchFunction(
        "held_regressor", [graph.state, graph.signs], [graph.machine.vector], [regressor]
    )


@cache
def sliding_kernel(terms: tuple[Term, ...]) -> BatchFunction:
    """State (18) → the rates (s) of dry friction and their slope to λ, λ̇ (s, 12)."""
    graph = hexapod_graph(terms)
    moving = ca.vertcat(graph.pose, graph.rate)
    slope = ca.jacobian(graph.sliding, moving)
    return BatchFunction("sliding", [graph.state], [graph.geometry.vector], [graph.sliding, slope])
