"""The 12 n + 7 variables of the design, scaled to order one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from expdesign.trajectory import FourierTrajectory, PhaseBasis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DesignVariables:
    """Centre and displacement amplitudes of each coordinate, and ω.

    In the displacement amplitudes a = μ/(kω), b = −ν/(kω) the pose and its derivatives to the
    phase are linear; ω enters as ω in the rates and ω² in the accelerations.

    Attributes
    ----------
    harmonics : int
    scale : (6,)
        What counts as one in the centre and first harmonic of each coordinate: m, rad.
    center : (6,)
        Pose that the scaled centre is measured from.
    omega_bounds : (float, float)
        rad/s.
    omega_scale : float
        What counts as one in ω, rad/s.
    """

    harmonics: int
    scale: Array
    center: Array
    omega_bounds: tuple[float, float]
    omega_scale: float

    @property
    def size(self) -> int:
        """12 n + 7."""
        return 12 * self.harmonics + 7

    @property
    def per_coordinate(self) -> int:
        """2 n + 1."""
        return 2 * self.harmonics + 1

    @property
    def units(self) -> Array:
        """What counts as one in centre and amplitudes, (6, 2 n + 1): m, rad.

        The amplitudes of harmonic k count k times: rates grow with k, accelerations with k², so
        that steps, boxes and noise of one size would else mean ever larger motions.
        """
        per = 1.0 / np.arange(1, self.harmonics + 1)
        return self.scale[:, None] * np.concatenate([[1.0], per, per])

    def bounds(self) -> tuple[Array, Array]:
        """Return (12 n + 7,) lower and upper bounds; only ω has any."""
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
        return np.append((table / self.units).ravel(), trajectory.omega / self.omega_scale)

    def amplitudes(self, variables: Array) -> tuple[Array, float]:
        """Return centre and amplitudes, (6, 2 n + 1), in m and rad, and ω in rad/s."""
        table = variables[:-1].reshape(6, self.per_coordinate) * self.units
        table[:, 0] += self.center
        return table, float(variables[-1] * self.omega_scale)

    def extended(self, variables: Array, harmonics: int) -> Array:
        """Return the same motion in the variables of a series with more harmonics."""
        n = self.harmonics
        table = variables[:-1].reshape(6, self.per_coordinate)
        more = np.zeros((6, harmonics - n))
        parts = [table[:, : n + 1], more, table[:, n + 1 :], more]
        return np.append(np.concatenate(parts, axis=1).ravel(), variables[-1])

    def trajectory(self, variables: Array) -> FourierTrajectory:
        """Return the trajectory of scaled variables."""
        table, omega = self.amplitudes(variables)
        n = self.harmonics
        return FourierTrajectory.from_displacements(
            omega, table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :]
        )

    def states(self, variables: Array, basis: PhaseBasis) -> Array:
        """Return pose, rate and acceleration at the basis's phases, (N, 18)."""
        table, omega = self.amplitudes(variables)
        return np.concatenate(
            [
                basis.value @ table.T,
                omega * (basis.first @ table.T),
                omega**2 * (basis.second @ table.T),
            ],
            axis=1,
        )

    def to_variables(self, variables: Array, basis: PhaseBasis, sensitivities: Array) -> Array:
        """Carry sensitivities to the states over to the variables, sample by sample.

        Parameters
        ----------
        sensitivities : (N, r, 18)
            Derivatives of r quantities of each sample with respect to its state.

        Returns
        -------
        (N, r, 12 n + 7)
        """
        omega = float(variables[-1] * self.omega_scale)
        count, rows = sensitivities.shape[:2]
        steps = np.stack([basis.value, omega * basis.first, omega**2 * basis.second], axis=1)
        by_coordinate = sensitivities.reshape(count, rows, 3, 6).transpose(0, 1, 3, 2)
        linear = np.matmul(by_coordinate.reshape(count, rows * 6, 3), steps)
        linear = linear.reshape(count, rows, 6, self.per_coordinate) * self.units
        drift = self.state_slope_to_omega(variables, basis)
        to_omega = np.einsum("nrs,ns->nr", sensitivities, drift)
        return np.concatenate(
            [linear.reshape(count, rows, 6 * self.per_coordinate), to_omega[:, :, None]],
            axis=2,
        )

    def accumulate(self, variables: Array, basis: PhaseBasis, sensitivities: Array) -> Array:
        """Sum over the samples what `to_variables` would give: (r, 12 n + 7).

        The sum is done coordinate by coordinate as matrix products, without the large array.
        """
        omega = float(variables[-1] * self.omega_scale)
        count, rows = sensitivities.shape[:2]
        steps = np.stack([basis.value, omega * basis.first, omega**2 * basis.second], axis=1)
        flat_steps = steps.reshape(3 * count, self.per_coordinate)
        split = sensitivities.reshape(count, rows, 3, 6)
        blocks = [
            split[:, :, :, i].transpose(1, 0, 2).reshape(rows, 3 * count) @ (flat_steps * units)
            for i, units in enumerate(self.units)
        ]
        drift = self.state_slope_to_omega(variables, basis)
        to_omega = np.tensordot(sensitivities, drift, axes=([0, 2], [0, 1]))
        return np.concatenate([*blocks, to_omega[:, None]], axis=1)

    def state_slope_to_omega(self, variables: Array, basis: PhaseBasis) -> Array:
        """Return the derivative of the states (N, 18) with respect to the scaled ω."""
        table, omega = self.amplitudes(variables)
        zero = np.zeros((basis.value.shape[0], 6))
        slope = np.concatenate(
            [zero, basis.first @ table.T, 2 * omega * (basis.second @ table.T)], axis=1
        )
        return slope * self.omega_scale
