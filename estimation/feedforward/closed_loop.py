"""A machine that follows a motion under its controller, simulated several times side by side."""

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
"""Error of a length, m, at which a machine has left its motion for good."""
_TOLD = 500
"""Samples between two words about how far it is."""


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be followed, at T samples of the controller."""

    lengths: Array
    """(T, 6), wanted, m."""
    noise: Array
    """(T, 6), of the measured lengths, m."""
    resolution: float
    """Step of the length sensors, m; 0: none."""
    gains: Array
    """(T, 6), measured over true force: a drive that is commanded Q gives Q over its gain."""


@dataclass(frozen=True, eq=False)
class Followed:
    """What C machines did at T samples."""

    states: Array
    """(C, T, 12), pose and rate."""
    lengths: Array
    """(C, T, 6), m, without noise."""
    commands: Array
    """(C, T, 6), N."""
    limited: Mask
    """(C, T, 6), whether a force was at its limit."""


def followed(
    machine: ForwardDynamics,
    controller: Controller,
    task: Task,
    feedforward: Mapping[CaseName, Array],
    start: Array,
    integral: Array,
    substeps: int,
) -> Followed:
    """Simulate the loop: the controller samples, its forces are held until the next sample.

    Parameters
    ----------
    machine : ForwardDynamics
    controller : Controller
    task : Task
    feedforward : mapping of (T, 6) arrays
        Forces that are added to the controller's, N, by the name of each of the C cases.
    start : (12,) array
        Pose and rate at the first sample.
    integral : (C, 6) array
        Of the controllers at the first sample, N.
    substeps : int
        Steps of the integration between two samples.

    Raises
    ------
    ComputationError
        A machine leaves its motion, and in which case: the loop is unstable.
    """
    given = np.array(list(feedforward.values()))
    cases, count, _ = given.shape
    states = np.empty((cases, count, len(start)))
    lengths, commands = (np.empty((cases, count, ACTUATORS)) for _ in range(2))
    limited = np.empty((cases, count, ACTUATORS), dtype=bool)
    advanced = machine.stepping(controller.step / substeps)
    state = np.tile(start, (cases, 1))
    length = machine.model.robot.lengths_and_jacobian(state[:, :6])[0]
    kept = ControllerState(None, np.zeros((cases, ACTUATORS)), integral)
    for k in range(count):
        if k % _TOLD == 0:
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
        commands[:, k], limited[:, k], kept = controller.commanded(kept, error, given[:, k])
        forces = commands[:, k] / task.gains[k]
        for _ in range(substeps):
            state, length = advanced(state, forces)
    return Followed(states, lengths, commands, limited)


class ControllerState(NamedTuple):
    """What a controller keeps from one sample to the next, (C, 6) each, of C machines."""

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
    """Of the filter: share of its last value that it keeps in a sample."""
    step: float
    """Between samples, s."""
    limit: tuple[Array, Array]
    """Smallest and largest force, N; ±inf where none is stated."""

    @classmethod
    def of(
        cls, section: FeedforwardSection, mass: Array, step: float, limit: tuple[Array, Array]
    ) -> Controller:
        """Derive the gains from the masses of the struts, (6,), kg."""
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

    def commanded(
        self, state: ControllerState, error: Array, feedforward: Array
    ) -> tuple[Array, Mask, ControllerState]:
        """Return forces (C, 6), N, whether each is at its limit, and what is kept.

        The integral waits while a force is at its limit.

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
