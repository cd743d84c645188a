"""The 12 n + 7 variables of the design, scaled by the reach of each coordinate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.problem.program import PathSlope
from expdesign.robot import LimitModel
from expdesign.trajectory import FourierTrajectory, PhaseBasis

LARGEST_ANGLE = np.pi / 2

_STEPS = 400
_ENOUGH_STEPS = 100
_REFINEMENTS = 4
_SMALLEST_SHARE = 1e-6


@dataclass(frozen=True)
class DesignVariables:
    """Centre and displacement amplitudes of each coordinate, and ω.

    In the displacement amplitudes a = μ/(kω), b = −ν/(kω) the pose and its derivatives to the
    phase are linear; ω enters as ω in the rates and ω² in the accelerations.

    A series that starts at rest has Σ k a_k = 0 and Σ k² b_k = 0 in every coordinate. Its variables
    are coordinates in the null space of these two equations, which therefore always hold.
    """

    harmonics: int
    scale: Array
    """(6,), scale of each coordinate: m, rad."""
    center: Array
    """(6,), origin of the scaled centre: m, rad."""
    omega_bounds: tuple[float, float]
    """rad/s."""
    omega_scale: float
    """Scale of ω, rad/s."""
    rest: bool = False
    """True for series whose rate and acceleration vanish at t = 0."""
    jerk: bool = False
    """True where the states end with the third derivative."""

    @property
    def size(self) -> int:
        """12 n + 7, or 12 n − 5 for a series that starts at rest."""
        return COORDINATES * self.per_coordinate + 1

    @property
    def per_coordinate(self) -> int:
        """2 n + 1, or 2 n − 1 for a series that starts at rest."""
        return 2 * self.harmonics + 1 - 2 * self.rest

    @property
    def orders(self) -> Array:
        """(per_coordinate,) harmonic of each variable of a coordinate, 1 for the centre.

        A variable of a series that starts at rest moves several harmonics: the highest of them.
        """
        n = self.harmonics
        return np.concatenate(
            [[1.0], np.arange(1 + self.rest, n + 1), np.arange(1 + self.rest, n + 1)]
        )

    @cached_property
    def units(self) -> Array:
        """Scales of centre and amplitudes, (6, 2 n + 1): m, rad.

        The scale of harmonic k is divided by k: rates grow with k, accelerations with k², and
        steps, boxes and noise of one size should mean similar motions for every harmonic.
        """
        return self.scale[:, None] * self._shares

    @cached_property
    def _shares(self) -> Array:
        """(2 n + 1,) scales of centre and amplitudes over the coordinate's scale."""
        per = 1.0 / np.arange(1, self.harmonics + 1)
        return np.concatenate([[1.0], per, per])

    def bounds(self) -> tuple[Array, Array]:
        """Return (size,) lower and upper bounds; only those of ω are finite."""
        lower, upper = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        lower[-1], upper[-1] = (bound / self.omega_scale for bound in self.omega_bounds)
        return lower, upper

    def pack(self, trajectory: FourierTrajectory) -> Array:
        """Return the scaled variables of a trajectory."""
        table = np.concatenate(
            [
                (trajectory.lambda0 - self.center)[:, None],
                trajectory.sine,
                trajectory.cosine,
            ],
            axis=1,
        )
        scaled = self.to_variables(table / self.units)
        return np.append(scaled.ravel(), trajectory.omega / self.omega_scale)

    def amplitudes(self, variables: Array) -> tuple[Array, float]:
        """Return centre and amplitudes, (6, 2 n + 1), in m and rad, and ω in rad/s."""
        table = self._table(variables) * self.units
        table[:, 0] += self.center
        return table, float(variables[-1] * self.omega_scale)

    def extend(self, variables: Array, harmonics: int) -> Array:
        """Return the same motion in the variables of a series with more harmonics."""
        n = self.harmonics
        table = self._table(variables)
        more = np.zeros((COORDINATES, harmonics - n))
        parts = [table[:, : n + 1], more, table[:, n + 1 :], more]
        longer = replace(self, harmonics=harmonics)
        return np.append(longer.to_variables(np.concatenate(parts, axis=1)).ravel(), variables[-1])

    def trajectory(self, variables: Array) -> FourierTrajectory:
        """Return the trajectory of scaled variables."""
        table, omega = self.amplitudes(variables)
        n = self.harmonics
        return FourierTrajectory.from_displacements(
            omega, table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :]
        )

    def states(self, variables: Array, basis: PhaseBasis) -> Array:
        """Return pose, rate and acceleration at the basis's phases, (N, 18), or (N, 24)."""
        table, omega = self.amplitudes(variables)
        further = [omega**3 * (self._third(basis) @ table.T)] if self.jerk else []
        return np.concatenate([*basis.samples(table, omega), *further], axis=1)

    def slope(self, variables: Array, basis: PhaseBasis) -> PathSlope:
        """Return the derivatives of the states at the basis's phases to the scaled variables."""
        table, omega = self.amplitudes(variables)
        parts = [basis.value, omega * basis.first, omega**2 * basis.second]
        if self.jerk:
            parts.append(omega**3 * self._third(basis))
        steps = np.stack(parts, axis=1) * self._shares
        drift = np.zeros((len(steps), len(parts), COORDINATES))
        drift[:, 1] = basis.first @ table.T
        drift[:, 2] = 2 * omega * (basis.second @ table.T)
        if self.jerk:
            drift[:, 3] = 3 * omega**2 * (self._third(basis) @ table.T)
        return PathSlope(self.to_variables(steps), self.scale, drift * self.omega_scale)

    def _third(self, basis: PhaseBasis) -> Array:
        orders = np.arange(1, self.harmonics + 1)
        return -(np.concatenate([[0], orders, orders]) ** 2) * basis.first

    def _table(self, variables: Array) -> Array:
        """Return the scaled centre and amplitudes, (6, 2 n + 1)."""
        table = variables[:-1].reshape(COORDINATES, self.per_coordinate)
        return table @ _rest_basis(self.harmonics).T if self.rest else table.copy()

    def to_variables(self, table: Array) -> Array:
        """Return the variables (…, per_coordinate) of a table; at rest those of its projection."""
        return table @ _rest_basis(self.harmonics) if self.rest else table


@cache
def _rest_basis(harmonics: int) -> Array:
    """Return an orthonormal basis (2 n + 1, 2 n − 1) of the series that start at rest.

    Columns: the centre, then for the sines and for the cosines one per harmonic from the second
    on, which moves that harmonic and the lower ones.
    """
    columns = np.zeros((2 * harmonics + 1, 2 * harmonics - 1))
    columns[0, 0] = 1.0
    orders = np.arange(1.0, harmonics + 1)
    # An amplitude is its variable over k: Σ k a_k = 0 and Σ k² b_k = 0 have these weights.
    for part, weights in enumerate((np.ones(harmonics), orders)):
        for k in range(1, harmonics):
            # Orthogonal to the weights and to the columns before: the weights' head, turned.
            column = np.zeros(harmonics)
            column[:k] = weights[:k] * weights[k]
            column[k] = -np.sum(weights[:k] ** 2)
            rows = slice(1 + part * harmonics, 1 + (part + 1) * harmonics)
            columns[rows, k + part * (harmonics - 1)] = column / np.linalg.norm(column)
    columns.setflags(write=False)
    return columns


def coordinate_reach(model: LimitModel) -> tuple[Array, Array]:
    """Return middle (6,) and half-width (6,) of the motion that the limits allow at rest: m, rad.

    Each coordinate moves alone from home, in both directions, up to the limits. Unlimited angles
    count as 90°, unlimited positions as ten characteristic lengths. The middle moves back towards
    home until all coordinates together keep the limits.
    """
    robot = model.robot
    farthest = np.array([10 * robot.characteristic_length] * 3 + [LARGEST_ANGLE] * 3)
    shares = np.linspace(0, 1, _STEPS + 1)[1:]
    sides = np.zeros((2, COORDINATES))
    for i in range(COORDINATES):
        for row, side in enumerate((-1.0, 1.0)):
            span = farthest[i]
            # Ever finer: a machine may move a thousandth of its size.
            for _ in range(_REFINEMENTS):
                states = np.zeros((shares.size, 3 * COORDINATES))
                states[:, :COORDINATES] = robot.home
                states[:, i] += side * shares * span
                kept = np.all(model.violations(states) <= 0, axis=1)
                steps = shares.size if np.all(kept) else int(np.argmin(kept))
                if steps >= _ENOUGH_STEPS:
                    break
                span *= (steps + 1) / shares.size
            sides[row, i] = span * steps / shares.size
    half = np.maximum(sides.sum(axis=0) / 2, _SMALLEST_SHARE * farthest)
    offset = (sides[1] - sides[0]) / 2
    for share in (1.0, 0.5, 0.25, 0.125):
        state = np.concatenate([robot.home + share * offset, np.zeros(2 * COORDINATES)])[None, :]
        if np.all(model.violations(state) < 0):
            return robot.home + share * offset, half
    return robot.home.copy(), half
