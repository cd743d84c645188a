"""Lengths of the struts, and what follows from them, over cells of time."""

from __future__ import annotations

from functools import cache

import casadi as ca

from expdesign.enclosure.instructions import EnclosedFunction
from expdesign.enclosure.matrices import TaylorMatrix
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Term, kinematic_terms
from expdesign.robot import Robot


class EnclosedKinematics:
    """A machine's own kinematics, for Taylor models."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._functions = _functions(kinematic_terms(robot.terms))
        self._geometry = [TaylorModel.number(value) for value in robot.geometry_vector]

    def lengths(self, pose: list[TaylorModel]) -> list[TaylorModel]:
        """Return the six lengths of a pose, m."""
        return self._functions([pose, _nothing(), self._geometry], [0])[0]

    def jacobian(self, pose: list[TaylorModel], cells: int) -> TaylorMatrix:
        """Return ∂q/∂λ."""
        entries = self._functions([pose, _nothing(), self._geometry], [1])[1]
        return TaylorMatrix.of(entries, ACTUATORS, cells)

    def rate(
        self, pose: list[TaylorModel], speed: list[TaylorModel]
    ) -> tuple[list[TaylorModel], TaylorMatrix]:
        """Return λ̇ of a pose whose struts have these speeds, and (∂q/∂λ)⁻¹."""
        cells = max(model.radius.size for model in pose)
        inverse = self.jacobian(pose, cells).inverse()
        return _times(inverse, speed, cells), inverse

    def motion(
        self, pose: list[TaylorModel], speed: list[TaylorModel], acceleration: list[TaylorModel]
    ) -> tuple[list[TaylorModel], list[TaylorModel]]:
        """Return λ̇ and λ̈ of a pose whose struts have these speeds and accelerations."""
        rate, inverse = self.rate(pose, speed)
        # q̈ = J λ̈ + J̇ λ̇; the graph gives the second part at λ̈ = 0.
        rest = self._functions([pose, rate, self._geometry], [2])[2]
        left = [whole - part for whole, part in zip(acceleration, rest, strict=True)]
        return rate, _times(inverse, left, len(inverse.radius))


def _times(matrix: TaylorMatrix, column: list[TaylorModel], cells: int) -> list[TaylorModel]:
    return (matrix @ TaylorMatrix.of(column, ACTUATORS, cells)).models()


def _nothing() -> list[TaylorModel]:
    return [TaylorModel.number(0.0)] * COORDINATES


@cache
def _functions(terms: tuple[Term, ...]) -> EnclosedFunction:
    """Pose, rate, geometry → lengths, ∂q/∂λ column by column, and accelerations at λ̈ = 0."""
    graph = hexapod_graph(terms)
    lengths = graph.kinematic["strut_length"]
    none = ca.SX.zeros(COORDINATES)
    rest = ca.substitute(graph.kinematic["strut_acceleration"], graph.acceleration, none)
    outputs = [lengths, ca.vec(ca.densify(ca.jacobian(lengths, graph.pose))), rest]
    return EnclosedFunction([graph.pose, graph.rate, graph.geometry.vector], outputs)
