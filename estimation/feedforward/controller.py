"""A position controller for each strut by itself: PID with feed-forward, sampled.

With the error e of a strut's measured length, i(t) = ∫ e and ė by filtered differences,

    Q = Q_ff + k e + d ė + k_i i,   k = m ω², d = 2 D m ω, k_i = k ω_i

for the mass m that a strut feels while the others are held, the natural frequency ω, the damping
ratio D and the corner frequency ω_i of the integral action. That is the usual cascade of a
controller k/d of positions around one of speeds with the gain d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.configuration.sections.feedforward import FeedforwardSection


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
