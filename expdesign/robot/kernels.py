"""The graph's functions that robots share, compiled once for all or once for the same terms."""

from __future__ import annotations

from functools import cache

import casadi as ca

from expdesign.mechanism.graph import Friction, hexapod_graph
from expdesign.mechanism.term import Term
from expdesign.robot.batch import BatchFunction

STRUT_MOTION = (
    "strut_length",
    "strut_speed",
    "strut_acceleration",
    "alpha",
    "alpha_rate",
    "beta",
    "beta_rate",
)


@cache
def length_kernel() -> BatchFunction:
    """Pose (6) → strut lengths (6) and their Jacobian to the pose (6, 6)."""
    graph = hexapod_graph()
    lengths = graph.kinematic["strut_length"]
    slope = ca.jacobian(lengths, graph.pose)
    return BatchFunction("lengths", [graph.pose], [graph.geometry.vector], [lengths, slope])


@cache
def motion_kernel() -> BatchFunction:
    """State (18) → the quantities `STRUT_MOTION` (6 each)."""
    graph = hexapod_graph()
    outputs = [graph.kinematic[name] for name in STRUT_MOTION]
    return BatchFunction("strut_motion", [graph.state], [graph.geometry.vector], outputs)


@cache
def regressor_kernel(terms: tuple[Term, ...]) -> BatchFunction:
    """State (18) → regressor (6, m) with the exact signs of dry friction."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.EXACT)
    return BatchFunction("regressor", [graph.state], [graph.machine.vector], [regressor])
