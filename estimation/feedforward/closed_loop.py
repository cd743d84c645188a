"""Closed loop of a machine and a position controller, simulated for several feed-forwards at once.

The controller of each strut is a sampled PID with feed-forward. With the error e of the measured
length, i(t) = ∫ e and ė by filtered differences,

    Q = Q_ff + k e + d ė + k_i i,   k = m ω², d = 2 D m ω, k_i = k ω_i

for the effective mass m of a strut with the others held, the natural frequency ω, the damping ratio
D and the corner frequency ω_i of the integral action. It is the usual cascade of a position
controller k/d around a speed controller with the gain d.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from constraints.arrays import Array, Mask
from estimation.feedforward.forward_dynamics import ForwardDynamics
from estimation.feedforward.result import CaseName
from estimation.twin.disturbances import quantised
from expdesign.configuration import ComputationError
from expdesign.configuration.sections.motions import FeedforwardSection
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import report_progress

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
    machine : ForwardDynamics
    controller : Controller
    task : TrackingTask
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
        measured = quantised(length + task.noise[k], task.resolution)
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

        The integral is held while a force is at its limit (anti-windup).

        Parameters
        ----------
        error, feedforward : (C, 6) array
            m and N.
        """
        before = error if state.error is None else state.error
        rate = (error - before) / self.step
        speed = self.lag * state.speed + (1 - self.lag) * rate
        wanted = feedforward + self.stiffness * error + self.damping * speed + state.integral
        given = np.clip(wanted, *self.limit)
        limited = given != wanted
        grown = state.integral + np.where(limited, 0.0, self.integral * self.step * error)
        return given, limited, ControllerState(error, speed, grown)
