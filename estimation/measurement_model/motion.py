"""The motion ξ that estimation knows: a Fourier series of the pose, and how samples follow it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory import FourierTrajectory, PhaseBasis


@dataclass(frozen=True, eq=False)
class HarmonicMotion:
    """The kinematic unknowns ξ of one experiment."""

    table: Array
    """(6, 2 H + 1), centre, sine and cosine amplitudes of each pose coordinate: m, rad."""
    omega: float
    """rad/s."""
    free_frequency: bool = False
    """ω is one of the unknowns: ξ is the table row by row, then ω."""

    @property
    def harmonics(self) -> int:
        """H."""
        return (self.table.shape[1] - 1) // 2

    @property
    def unknowns(self) -> int:
        """Length x of ξ."""
        return self.table.size + int(self.free_frequency)

    @property
    def trajectory(self) -> FourierTrajectory:
        """The same motion in the paper's coefficients."""
        h = self.harmonics
        return FourierTrajectory.from_displacements(
            self.omega, self.table[:, 0], self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        )

    @classmethod
    def of(cls, trajectory: FourierTrajectory, *, free_frequency: bool = False) -> HarmonicMotion:
        """Take the motion of a trajectory."""
        table = np.concatenate(
            [trajectory.lambda0[:, None], trajectory.sine, trajectory.cosine], axis=1
        )
        return cls(table, trajectory.omega, free_frequency)

    def with_harmonics(self, harmonics: int) -> HarmonicMotion:
        """Return the motion with more harmonics, the new ones zero, or with the first few."""
        old = self.harmonics
        few = min(old, harmonics)
        table = np.zeros((COORDINATES, 2 * harmonics + 1))
        table[:, 0] = self.table[:, 0]
        table[:, 1 : few + 1] = self.table[:, 1 : few + 1]
        table[:, harmonics + 1 : harmonics + 1 + few] = self.table[:, old + 1 : old + 1 + few]
        return replace(self, table=table)

    def delayed(self, time: float) -> HarmonicMotion:
        """Return the motion that does at t what this one does at t − time, s."""
        h = self.harmonics
        phases = self.omega * time * np.arange(1, h + 1)
        cos, sin = np.cos(phases), np.sin(phases)
        sines, cosines = self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        parts = [self.table[:, :1], sines * cos + cosines * sin, cosines * cos - sines * sin]
        return replace(self, table=np.concatenate(parts, axis=1))

    def moved(self, step: Array) -> HarmonicMotion:
        """Return the motion with ξ + step."""
        size = self.table.size
        omega = self.omega + float(step[size]) if self.free_frequency else self.omega
        table = self.table + step[:size].reshape(self.table.shape)
        return replace(self, table=table, omega=omega)

    def at(self, times: Array) -> SampledMotion:
        """Return the motion at the times given, s."""
        phases = PhaseBasis.at(self.omega * times, self.harmonics)
        orders = np.arange(1, self.harmonics + 1)
        third = -(np.concatenate([[0.0], orders, orders]) ** 2) * phases.first
        derivatives = (phases.value, phases.first, phases.second, third)
        return SampledMotion(
            self, times, tuple(self.omega**n * basis for n, basis in enumerate(derivatives))
        )


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A motion at S instants, s."""

    motion: HarmonicMotion
    times: Array
    basis: tuple[Array, ...]
    """(S, 2 H + 1), derivatives 0 … 3 of 1, sin kωt, cos kωt with respect to time."""

    def state(self, first: int = 0) -> Array:
        """Return λ, λ̇, λ̈, or from another derivative on, (S, 18)."""
        return np.concatenate([b @ self.motion.table.T for b in self.basis[first : first + 3]], 1)

    def chain(self, slope: Array) -> Array:
        """Carry slopes to the pose and its n − 1 first derivatives, (S, r, 6 n), over to ξ."""
        count, rows, depth = slope.shape
        table, orders = self.motion.table, depth // COORDINATES
        by_order = slope.reshape(count, rows, orders, COORDINATES).transpose(0, 1, 3, 2)
        basis = np.stack(self.basis[:orders], axis=1)
        carried = np.matmul(by_order.reshape(count, rows * COORDINATES, orders), basis)
        result = carried.reshape(count, rows, table.size)
        if not self.motion.free_frequency:
            return result
        # A higher frequency runs through the same phases sooner.
        omega, (rate, acceleration, jerk) = self.motion.omega, (b @ table.T for b in self.basis[1:])
        stretch = self.times[:, None] / omega
        change = [
            stretch * rate,
            rate / omega + stretch * acceleration,
            2 * acceleration / omega + stretch * jerk,
        ]
        column = np.einsum("sri,si->sr", slope, np.concatenate(change, axis=1)[:, :depth])
        return np.concatenate([result, column[:, :, None]], axis=2)
