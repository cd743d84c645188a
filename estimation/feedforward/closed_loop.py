"""Closed loop of a machine and a position controller, simulated for several feed-forwards at once.

The controller of each strut is a sampled PID with feed-forward. With the error e of the measured
length, i(t) = ∫ e and ė by filtered differences,

    Q = Q_ff + k e + d ė + k_i i,   k = m ω², d = 2 D m ω, k_i = k ω_i

for the effective mass m of a strut with the others held, the natural frequency ω, the damping ratio
D and the corner frequency ω_i of the integral action. It is the usual cascade of a position
controller k/d around a speed controller with the gain d.

The motion follows from the inverse dynamics solved for λ̈, M(λ) λ̈ + h(λ, λ̇) = Q, step by step. The
sign of dry friction is smoothed to tanh(v/w): a strut at rest creeps more slowly than w, while a
real one sticks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from constraints.arrays import Array, Mask
from estimation.feedforward.result import CaseName
from estimation.twin.disturbances import quantise
from expdesign.configuration import ComputationError
from expdesign.configuration.experiment import Cogging, FeedforwardSection
from expdesign.evaluation.batch import Graph, kernel
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.progress import report_progress
from expdesign.robot import Robot
from expdesign.trajectory import PoseSamples

_LOST = 1.0
"""Error of a length, m, that no controller recovers from."""
_REPORT_EVERY = 500
"""Samples between two reports of progress."""


@dataclass(frozen=True, eq=False)
class TrackingTask:
    """The commanded motion and the sensors, at T samples of the controller."""

    lengths: Array
    """(T, 6), commanded, m."""
    noise: Array
    """(T, 6), of the measured lengths, m."""
    resolution: float
    """Step of the length sensors, m; 0: none."""
    gains: Array
    """(T, 6), measured over true force: the command Q makes a force of Q over its gain."""


@dataclass(frozen=True, eq=False)
class FollowedMotion:
    """Motion of C machines at T samples."""

    states: Array
    """(C, T, 12), pose and rate."""
    lengths: Array
    """(C, T, 6), m, without noise."""
    commands: Array
    """(C, T, 6), N."""
    limited: Mask
    """(C, T, 6), true where a force was at its limit."""


def follow_motion(
    machine: ForwardDynamics,
    controller: Controller,
    task: TrackingTask,
    feedforward: Mapping[CaseName, Array],
    start: Array,
    integral: Array,
    substeps: int,
) -> FollowedMotion:
    """Simulate the loop; the controller's forces are held from one sample to the next.

    Parameters
    ----------
    feedforward : mapping of (T, 6) arrays
        Forces added to the controller's, N, by the names of the C cases.
    start : (12,) array
        Pose and rate at the first sample.
    integral : (C, 6) array
        Of the controllers at the first sample, N.
    substeps : int
        Steps of the integration between two samples.

    Raises
    ------
    ComputationError
        The loop of a case is unstable; the message names it.
    """
    given = np.array(list(feedforward.values()))
    cases, count, _ = given.shape
    states = np.empty((cases, count, len(start)))
    lengths, commands = (np.empty((cases, count, ACTUATORS)) for _ in range(2))
    limited = np.empty((cases, count, ACTUATORS), dtype=bool)
    advance = machine.stepper(controller.step / substeps)
    state = np.tile(start, (cases, 1))
    length = machine.model.robot.lengths_and_jacobian(state[:, :6])[0]
    kept = ControllerState(None, np.zeros((cases, ACTUATORS)), integral)
    for k in range(count):
        if k % _REPORT_EVERY == 0:
            report_progress("following the motion", k, count)
        states[:, k], lengths[:, k] = state, length
        measured = quantise(length + task.noise[k], task.resolution)
        error = task.lengths[k] - measured
        lost = ~(np.max(np.abs(error), axis=1) < _LOST)  # NaN too
        if np.any(lost):
            cases_lost = (case for case, left in zip(feedforward, lost, strict=True) if left)
            named = ", ".join(f"'{case}'" for case in cases_lost)
            raise ComputationError(
                f"the machine leaves its motion {k * controller.step:.3g} s after the start with "
                f"the feed-forward {named}: its controller is unstable, or too weak for the limits "
                "of its forces; try another feedforward.bandwidth"
            )
        commands[:, k], limited[:, k], kept = controller.command(kept, error, given[:, k])
        forces = commands[:, k] / task.gains[k]
        for _ in range(substeps):
            state, length = advance(state, forces)
    return FollowedMotion(states, lengths, commands, limited)


class ControllerState(NamedTuple):
    """State of the controllers of C machines, (C, 6) each."""

    error: Array | None
    """m; None before the first sample."""
    speed: Array
    """Filtered ė, m/s."""
    integral: Array
    """k_i i, N."""


@dataclass(frozen=True, eq=False)
class Controller:
    """Gains of the six struts, (6,) each."""

    mass: Array
    """kg."""
    stiffness: Array
    """N/m."""
    damping: Array
    """N s/m."""
    integral: Array
    """N/(m s)."""
    lag: float
    """Coefficient of the filter: the share of its last output in the next one."""
    step: float
    """Between samples, s."""
    limit: tuple[Array, Array]
    """Smallest and largest force, N; ±inf without a limit."""

    @classmethod
    def of(
        cls, section: FeedforwardSection, mass: Array, step: float, limit: tuple[Array, Array]
    ) -> Controller:
        """Compute the gains from the effective masses of the struts, (6,), kg."""
        frequency = 2 * np.pi * section.bandwidth
        stiffness = mass * frequency**2
        return cls(
            mass=mass,
            stiffness=stiffness,
            damping=2 * section.damping * mass * frequency,
            integral=stiffness * 2 * np.pi * section.integral,
            lag=float(np.exp(-2 * np.pi * section.filter * step)),
            step=step,
            limit=limit,
        )

    def command(
        self, state: ControllerState, error: Array, feedforward: Array
    ) -> tuple[Array, Mask, ControllerState]:
        """Return forces (C, 6), N, whether each is at its limit, and the next state.

        The integral is held while a force is at its limit (anti-windup). Error and feed-forward
        are (C, 6), m and N.
        """
        before = error if state.error is None else state.error
        rate = (error - before) / self.step
        speed = self.lag * state.speed + (1 - self.lag) * rate
        wanted = feedforward + self.stiffness * error + self.damping * speed + state.integral
        given = np.clip(wanted, *self.limit)
        limited = given != wanted
        grown = state.integral + np.where(limited, 0.0, self.integral * self.step * error)
        return given, limited, ControllerState(error, speed, grown)


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

    def stepper(self, step: float) -> Callable[[Array, Array], list[Array]]:
        """Return a function that advances states (N, 12) by a step, s, at constant forces (N, 6).

        The function returns the new states and their lengths (N, 6).
        """
        kernel, fixed = _step_kernel(self.model.robot.terms), [*self._fixed, np.array([step])]
        return lambda states, forces: kernel(states, forces, *fixed)

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
