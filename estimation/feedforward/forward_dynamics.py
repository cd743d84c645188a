"""Forward dynamics of a hexapod: the motion due to given forces, step by step.

The inverse dynamics solved for λ̈: M(λ) λ̈ + h(λ, λ̇) = Q. The sign of dry friction is smoothed to
tanh(v/w): a strut at rest creeps more slowly than w, where a real one sticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.configuration.sections.experiment import Cogging
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.robot import Robot
from expdesign.trajectory import PoseSamples

_REACH = 1.5
"""Largest step, in time constants of the fastest mode; the Runge–Kutta method of order 4 is stable
up to 2.79 (Hairer, Wanner, Solving Ordinary Differential Equations II, IV.2)."""


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with values of its parameters, (m,), SI."""

    robot: Robot
    values: Array

    def forces(self, states: PoseSamples) -> Array:
        """Return the forces of a motion, (N, 6), N, by the inverse dynamics."""
        return self.robot.actuator_forces(*states, self.values)


class _Symbols:
    """Inputs of the kernels, and the acceleration as their expression."""

    def __init__(self, graph: HexapodGraph) -> None:
        self.state = ca.vertcat(graph.pose, graph.rate)
        self.forces = ca.SX.sym("forces", ACTUATORS)
        # Amplitude, angle per length and phase of the cogging
        self.cogging = ca.SX.sym("cogging", ACTUATORS, 3)
        cogging = ca.vec(self.cogging)
        self.fixed = [graph.machine, graph.parameters, graph.width, cogging]
        size, pitch, phase = ca.horzsplit(self.cogging)
        lengths = graph.kinematic["strut_length"]
        passed = self.forces - size * ca.sin(pitch * lengths + phase)
        self.acceleration = graph.acceleration_with(Friction.SMOOTH, passed)
        self.lengths = lengths


@kernel
def _step_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (12) and forces (6) → the state a step later, and the lengths there."""
    graph = hexapod_graph(terms)
    own = _Symbols(graph)
    step = ca.SX.sym("step")
    inputs = [own.state, own.forces, *own.fixed]
    slope = ca.Function("slope", inputs, [ca.vertcat(graph.rate, own.acceleration)])
    lengths = ca.Function("lengths", inputs, [own.lengths])

    def at(function: ca.Function, state: ca.SX) -> ca.SX:
        return function.call([state, *inputs[1:]], True, False)[0]

    one = at(slope, own.state)
    two = at(slope, own.state + step / 2 * one)
    three = at(slope, own.state + step / 2 * two)
    four = at(slope, own.state + step * three)
    after = own.state + step / 6 * (one + 2 * two + 2 * three + four)
    fixed = [*own.fixed, step]
    outputs = [after, at(lengths, after)]
    return Graph("forward_step", [own.state, own.forces], fixed, outputs)


@kernel
def _acceleration_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (12) and forces (6) → λ̈ (6) and its slopes to the rate and to the forces (6, 6)."""
    graph = hexapod_graph(terms)
    own = _Symbols(graph)
    outputs = [own.acceleration]
    outputs += [ca.jacobian(own.acceleration, by) for by in (graph.rate, own.forces)]
    return Graph("forward", [own.state, own.forces], own.fixed, outputs)


@dataclass(frozen=True, eq=False)
class ForwardDynamics:
    """A machine that forces move."""

    model: Model
    width: float
    """Speed of a strut over which the sign of dry friction is smoothed, m/s."""
    cogging: Cogging | None = None
    """Forces beyond the model's: Q = A p + c(q)."""

    def acceleration(self, states: Array, forces: Array) -> Array:
        """Return λ̈, (N, 6), of states (N, 12), pose and rate, and forces of actuators (N, 6)."""
        return self._slopes(states, forces)[0]

    def mass_matrix(self, pose: Array) -> Array:
        """Return M of Q = M q̈ + …, (6, 6), kg, of the actuators' coordinates q at a pose (6,)."""
        state = np.concatenate([pose, np.zeros(COORDINATES)])[None]
        by_force = self._slopes(state, np.zeros((1, ACTUATORS)))[2][0]
        return np.linalg.inv(self.model.robot.length_jacobian(pose) @ by_force)

    def longest_step(self, poses: Array) -> float:
        """Return a stable step for all of the poses (N, 6), s.

        Smoothed friction is fastest at standstill, where its slope is largest.
        """
        states = np.concatenate([poses, np.zeros_like(poses)], axis=1)
        by_rate = self._slopes(states, np.zeros_like(poses))[1]
        fastest = float(np.max(np.abs(np.linalg.eigvals(by_rate))))
        return _REACH / fastest if fastest > 0 else np.inf

    def stepper(self, step: float) -> Callable[[Array, Array], tuple[Array, Array]]:
        """Return a function that advances states (N, 12) by a step, s, at constant forces (N, 6).

        The function returns the new states and their lengths (N, 6).
        """
        kernel, fixed = _step_kernel(self.model.robot.terms), [*self._fixed, np.array([step])]

        def advance(states: Array, forces: Array) -> tuple[Array, Array]:
            after, lengths = kernel(states, forces, *fixed)
            return after, lengths

        return advance

    def _slopes(self, states: Array, forces: Array) -> list[Array]:
        return _acceleration_kernel(self.model.robot.terms)(states, forces, *self._fixed)

    @property
    def _fixed(self) -> list[Array]:
        robot, cogging = self.model.robot, np.zeros((3, ACTUATORS))
        if self.cogging is not None:
            own = self.cogging
            pitch = 2 * np.pi / np.asarray(own.pitch)
            cogging = np.array([own.amplitude, pitch, own.phase])
        machine = robot.with_load_at(self.model.values).machine
        return [machine, self.model.values, np.array([self.width]), cogging.ravel()]
