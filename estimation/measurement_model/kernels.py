"""Functions of the shared symbolic graph that only estimation needs: derivatives to the state."""

from __future__ import annotations

from functools import cache

import casadi as ca

from expdesign.mechanism.graph import Friction, hexapod_graph
from expdesign.robot.batch import BatchFunction


@cache
def force_kernel(*, general: bool) -> BatchFunction:
    """State (18), signs (18) → regressor A (6, m) and ∂(A p)/∂state (6, 18), signs held."""
    graph = hexapod_graph(general=general)
    regressor = graph.regressor_with(Friction.HELD)
    slope = ca.jacobian(regressor @ graph.parameters, graph.state)
    return BatchFunction(
        "force_sensitivity",
        [graph.state, graph.signs],
        [graph.geometry.vector, graph.parameters],
        [regressor, slope],
    )


@cache
def held_regressor_kernel(*, general: bool) -> BatchFunction:
    """State (18), signs (18) → regressor A (6, m) with the signs given."""
    graph = hexapod_graph(general=general)
    regressor = graph.regressor_with(Friction.HELD)
    return BatchFunction(
        "held_regressor", [graph.state, graph.signs], [graph.geometry.vector], [regressor]
    )


@cache
def sliding_kernel() -> BatchFunction:
    """State (18) → the rates l̇, α̇, β̇ (18) of dry friction and their slope to λ, λ̇ (18, 12)."""
    graph = hexapod_graph(general=False)
    moving = ca.vertcat(graph.pose, graph.rate)
    slope = ca.jacobian(graph.sliding, moving)
    return BatchFunction("sliding", [graph.state], [graph.geometry.vector], [graph.sliding, slope])
