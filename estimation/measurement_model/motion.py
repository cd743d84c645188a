"""The motion ξ that estimation knows: a Fourier series of the pose, and its basis in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory import FourierTrajectory, PhaseBasis


@dataclass(frozen=True, eq=False)
class MotionBasis:
    """The basis of λ and its derivatives at S instants.

    Attributes
    ----------
    times : (S,)
        s.
    omega : float
        rad/s.
    derivatives : tuple of four (S, 2 H + 1)
        Derivatives 0 … 3 of 1, sin kωt, cos kωt with respect to time.
    """

    times: Array
    omega: float
    derivatives: tuple[Array, Array, Array, Array]

    @classmethod
    def at(cls, times: Array, omega: float, harmonics: int) -> MotionBasis:
        """Evaluate the basis at the times given."""
        phases = PhaseBasis.at(omega * times, harmonics)
        orders = np.concatenate([[0.0], np.arange(1, harmonics + 1), np.arange(1, harmonics + 1)])
        third = -(orders**2) * phases.first
        return cls(
            times,
            omega,
            (phases.value, omega * phases.first, omega**2 * phases.second, omega**3 * third),
        )

    def state(self, table: Array, first: int = 0) -> Array:
        """Return λ, λ̇, λ̈ for coefficients (6, 2 H + 1), or from another derivative on, (S, 18)."""
        chosen = self.derivatives[first : first + 3]
        return np.concatenate([basis @ table.T for basis in chosen], axis=1)

    def frequency_slope(self, table: Array) -> Array:
        """Return ∂(λ, λ̇, λ̈)/∂ω, (S, 18): a higher frequency runs through the same phases sooner."""
        rate, acceleration, jerk = (basis @ table.T for basis in self.derivatives[1:])
        stretch = self.times[:, None] / self.omega
        first = stretch * rate
        second = rate / self.omega + stretch * acceleration
        third = 2 * acceleration / self.omega + stretch * jerk
        return np.concatenate([first, second, third], axis=1)


@dataclass(frozen=True, eq=False)
class HarmonicMotion:
    """The kinematic unknowns ξ of one experiment.

    Attributes
    ----------
    table : (6, 2 H + 1)
        Centre, sine and cosine amplitudes of each pose coordinate: m, rad.
    omega : float
        rad/s.
    """

    table: Array
    omega: float

    @property
    def harmonics(self) -> int:
        """H."""
        return (self.table.shape[1] - 1) // 2

    @property
    def trajectory(self) -> FourierTrajectory:
        """The same motion in the paper's coefficients."""
        h = self.harmonics
        return FourierTrajectory.from_displacements(
            self.omega, self.table[:, 0], self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        )

    @classmethod
    def of(cls, trajectory: FourierTrajectory) -> HarmonicMotion:
        """Take the motion of a trajectory."""
        table = np.concatenate(
            [trajectory.lambda0[:, None], trajectory.sine, trajectory.cosine], axis=1
        )
        return cls(table, trajectory.omega)

    def with_harmonics(self, harmonics: int) -> HarmonicMotion:
        """Return the motion with more harmonics, the new ones zero, or with the first few."""
        old = self.harmonics
        few = min(old, harmonics)
        table = np.zeros((COORDINATES, 2 * harmonics + 1))
        table[:, 0] = self.table[:, 0]
        table[:, 1 : few + 1] = self.table[:, 1 : few + 1]
        table[:, harmonics + 1 : harmonics + 1 + few] = self.table[:, old + 1 : old + 1 + few]
        return HarmonicMotion(table, self.omega)

    def delayed(self, time: float) -> HarmonicMotion:
        """Return the motion that does at t what this one does at t − time, s."""
        h = self.harmonics
        phases = self.omega * time * np.arange(1, h + 1)
        cos, sin = np.cos(phases), np.sin(phases)
        sines, cosines = self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        parts = [self.table[:, :1], sines * cos + cosines * sin, cosines * cos - sines * sin]
        return HarmonicMotion(np.concatenate(parts, axis=1), self.omega)

    def basis(self, times: Array) -> MotionBasis:
        """Return the basis at the times given, s."""
        return MotionBasis.at(times, self.omega, self.harmonics)

    def vector(self, *, free_frequency: bool) -> Array:
        """Return ξ: the coefficients row by row, then ω if it is free."""
        flat = self.table.ravel()
        return np.append(flat, self.omega) if free_frequency else flat.copy()

    def moved(self, step: Array, *, free_frequency: bool) -> HarmonicMotion:
        """Return the motion with ξ + step."""
        size = self.table.size
        omega = self.omega + float(step[size]) if free_frequency else self.omega
        return HarmonicMotion(self.table + step[:size].reshape(self.table.shape), omega)
