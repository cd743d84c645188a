"""What a control model computes, as functions of the shared graph.

Poses, rates and accelerations are λ, λ̇, λ̈: (6, 1) each, SI and radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.model import ControlModel
from expdesign.mechanism.friction_sign import Friction
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES, POSE, numbered
from expdesign.mechanism.term import Term

POSE_INPUT, RATE_INPUT, ACCELERATION_INPUT = "pose", "rate", "acceleration"


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
    states = {
        POSE_INPUT: graph.pose,
        RATE_INPUT: graph.rate,
        ACCELERATION_INPUT: graph.acceleration,
    }
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
        "forces": of("forces of the actuators", tuple(states), _borne(graph, signs)),
        "rest": of("forces that hold the platform still", (POSE_INPUT,), _borne(graph, *still)),
        "friction": of(
            "the friction's share of the forces",
            tuple(states),
            _borne(graph, signs, (graph.parameters, ca.vertcat(*rubbing))),
        ),
        "lengths": of("coordinates of the actuators", (POSE_INPUT,), [lengths]),
        "rates": of("speeds of the actuators", (POSE_INPUT, RATE_INPUT), [rates]),
        "slope": of(
            "coordinates of the actuators and their slope to the pose",
            (POSE_INPUT,),
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


def _borne(graph: HexapodGraph, *pairs: tuple[ca.SX, ca.SX]) -> list[ca.SX]:
    """Return Gᵀ, w and f, with values for symbols; w and f of the load before, where it counts."""
    borne = list(graph.borne_with(Friction.HELD))
    # All at once: the signs are expressions of pose and rate.
    symbols, values = map(list, zip(*pairs, strict=True))
    found = ca.substitute([ca.vec(graph.transposed), *borne], symbols, values)
    if any(ca.depends_on(part, graph.load) for part in found):
        found[1:1] = ca.substitute(
            borne, [graph.parameters], [graph.parameters * ca.DM(graph.loading)]
        )
    return found


OUTPUTS = (
    ("forces", "N", "force of actuator"),
    ("rest", "N", "force that holds the platform still, actuator"),
    ("friction", "N", "the friction's share of the force, actuator"),
    ("lengths", "m", "coordinate of actuator"),
    ("rates", "m/s", "speed of actuator"),
)
"""Of the pose, its rate and acceleration: name, unit and meaning."""
REASONS = (
    "the struts cannot hold the platform in this pose",
    "no pose of the measured lengths was found in which the struts hold the platform",
    "the pose of the measured lengths is turned by more than 45 deg from the one before",
)
"""What a status of the C functions says, from 1. The search meets the first one's poses on its way;
where it ends in one it says the second."""


class Variable(NamedTuple):
    """One number of a block."""

    name: str
    unit: str
    meaning: str
    start: float


@dataclass(frozen=True, eq=False)
class Block:
    """Six numbers that belong together."""

    name: str
    unit: str
    """Of an actuator's numbers; of those of the pose what follows the coordinate's own."""
    meaning: str
    """What comes before the coordinate's meaning, or the number of the actuator."""
    causality: Literal["input", "output", "parameter"]
    of: tuple[str, ...] = ()
    """Of an output: the inputs that it depends on."""
    start: Array | None = None
    """Of what is no output; None: zeros."""
    of_pose: bool = False
    """Whether there is one for each coordinate of the pose; else one for each actuator."""

    @property
    def variables(self) -> list[Variable]:
        """Its numbers one by one."""
        start = np.zeros(ACTUATORS) if self.start is None else self.start
        if self.of_pose:
            each = [
                (
                    f"{self.name}.{one.name}",
                    f"{one.unit}{self.unit}",
                    f"{self.meaning}{one.meaning}",
                )
                for one in POSE
            ]
        else:
            each = [(f"{self.name}[{j}]", self.unit, f"{self.meaning} {j}") for j in numbered("")]
        return [Variable(*one, value) for one, value in zip(each, start.tolist(), strict=True)]


def blocks(model: ControlModel) -> tuple[Block, ...]:
    """Return all blocks in their order.

    The last ones are of the forward kinematics, which need nothing of what comes before.
    """
    home, functions = model.robot.home, model.functions
    lengths = model.robot.inverse_kinematics(home)
    return (
        Block("pose", "", "", "input", start=home, of_pose=True),
        Block("rate", "/s", "rate of ", "input", of_pose=True),
        Block("acceleration", "/s2", "acceleration of ", "input", of_pose=True),
        *(Block(*one, "output", functions[one[0]].inputs) for one in OUTPUTS),
        Block("measured_lengths", "m", "measured coordinate of actuator", "input", start=lengths),
        Block("measured_rates", "m/s", "measured speed of actuator", "input"),
        Block(
            "measured_pose",
            "",
            "of the measured coordinates: ",
            "output",
            ("measured_lengths",),
            of_pose=True,
        ),
        Block(
            "measured_rate",
            "/s",
            "of the measured coordinates and speeds: rate of ",
            "output",
            ("measured_lengths", "measured_rates"),
            of_pose=True,
        ),
        Block(
            "start_pose",
            "",
            "where the first search for the measured pose begins: ",
            "parameter",
            start=home,
            of_pose=True,
        ),
    )
