"""Functions of a control model, built from the shared graph.

Poses, rates and accelerations are λ, λ̇, λ̈: (6, 1) each, SI and radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca

from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction, Term

POSE, RATE, ACCELERATION = "pose", "rate", "acceleration"


@dataclass(frozen=True, eq=False)
class ModelFunction:
    """A function of a control model."""

    does: str
    """In words."""
    inputs: tuple[str, ...]
    """Of pose, rate and acceleration."""
    function: ca.Function
    """(inputs, geometry (g), constants (c), parameters (m)) → outputs.

    Forces are given as Gᵀ column by column, w, and f of Q = G⁻ᵀ w + f: solving by elimination with
    pivots is a hundred times more exact in single precision than what CasADi writes for it. Where
    friction depends on the load of the actuators, which is such a Q itself, its w and f come
    before, and it is the last input.
    """
    loaded: bool = False
    """Whether it depends on the load."""


@cache
def model_functions(terms: tuple[Term, ...]) -> Mapping[str, ModelFunction]:
    """Return the functions of robots with these terms, by name.

    Those of forces are ``forces``, ``rest`` and ``friction``; those of the struts' lengths, the
    coordinates of the actuators, are ``lengths``, ``rates``, and ``slope``: lengths and, row by
    row, ∂q/∂λ.
    """
    graph = hexapod_graph(terms, open_load=True)
    states = {POSE: graph.pose, RATE: graph.rate, ACCELERATION: graph.acceleration}
    machine = [graph.geometry.vector, graph.constants, graph.parameters]

    def of(does: str, inputs: tuple[str, ...], outputs: list[ca.SX]) -> ModelFunction:
        loaded = any(ca.depends_on(part, graph.load) for part in outputs)
        given = [*(states[key] for key in inputs), *machine, *([graph.load] if loaded else [])]
        dense = [ca.densify(value) for value in outputs]
        function = ca.Function("model", given, dense, {"cse": True})
        return ModelFunction(does, inputs, function, loaded)

    lengths, rates = graph.kinematic["strut_length"], graph.kinematic["strut_speed"]
    signs = (graph.signs, ca.sign(sliding_speeds(graph)))
    zeros = ca.SX.zeros(COORDINATES)
    still = (
        (graph.signs, ca.SX.zeros(graph.signs.shape)),
        (graph.rate, zeros),
        (graph.acceleration, zeros),
    )
    rubbing = [
        graph.parameters[k] if sliding else ca.SX(0)
        for k, sliding in enumerate(bool(term.rates) for term in terms for _ in term.parameters)
    ]
    return {
        "forces": of("forces of the actuators", tuple(states), _actuator_forces(graph, signs)),
        "rest": of("forces that hold the platform still", (POSE,), _actuator_forces(graph, *still)),
        "friction": of(
            "the friction's share of the forces",
            tuple(states),
            _actuator_forces(graph, signs, (graph.parameters, ca.vertcat(*rubbing))),
        ),
        "lengths": of("coordinates of the actuators", (POSE,), [lengths]),
        "rates": of("speeds of the actuators", (POSE, RATE), [rates]),
        "slope": of(
            "coordinates of the actuators and their slope to the pose",
            (POSE,),
            [lengths, ca.vec(ca.jacobian(lengths, graph.pose).T)],
        ),
    }


def sliding_speeds(graph: HexapodGraph) -> ca.SX:
    """Return the speeds (s, 1), m/s, whose signs dry friction takes: rates times their arms.

    They have the signs of the rates. Written so, a file may smooth them with one width in m/s.
    """
    kinematic = graph.kinematic
    parts = [
        kinematic[rate.quantity] * (1 if rate.arm is None else kinematic[rate.arm])
        for rate in graph.rates
    ]
    return ca.vertcat(ca.SX(0, 1), *parts)


def _actuator_forces(graph: HexapodGraph, *pairs: tuple[ca.SX, ca.SX]) -> list[ca.SX]:
    """Return Gᵀ, w and f, with values for symbols; w and f of the load before, where it counts."""
    borne = list(graph.wrench_and_direct_forces(Friction.HELD))
    # All at once: the signs are expressions of pose and rate.
    symbols, values = map(list, zip(*pairs, strict=True))
    found = ca.substitute([ca.vec(graph.transposed), *borne], symbols, values)
    if any(ca.depends_on(part, graph.load) for part in found):
        found[1:1] = ca.substitute(
            borne, [graph.parameters], [graph.parameters * ca.DM(graph.loading)]
        )
    return found
