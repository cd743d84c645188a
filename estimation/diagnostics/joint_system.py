"""The linear regression behind all tests of the model: forces and lengths together, whitened.

One Gauss–Newton step in (p, ξ) takes the residuals of any estimator to where the model explains as
much of them as it can. What is left, e*, has the covariance W⁻¹ − U J⁻¹ Uᵀ whatever the estimator
was. A further column z is tested by its score s = zᵀ W e* with the information
I = zᵀ W z − zᵀ W U J⁻¹ Uᵀ W z: its coefficient is I⁻¹ s, and sᵀ I⁻¹ s is χ² if there is none.

For held-out data the parameters are not fitted: they come with the information Cov(p̂)⁻¹.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation
from estimation.measurement_model.normal_equations import NormalEquations, whitened
from estimation.processing import NoiseModel
from expdesign.information.fisher import ScaledInformation, whitening

_DETERMINED = 1e-12
"""Eigenvalues of the scaled J below this share of the largest belong to dependent columns."""


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Whitened rows of one experiment, with what is known of the unknowns from elsewhere."""

    white: Array
    """(6, 6), S: S Σ Sᵀ = 1."""
    counts: Array
    """(R,), samples that each row is the mean of."""
    forces: Array
    columns: Array
    """(R, 6) and (R, 6, u), whitened: residuals before the step; columns of the unknowns (free
    parameters, motion, effects that were included)."""
    information: Array
    gradient: Array
    """(u, u) and (u,), of the unknowns from the lengths, from other experiments and from priors."""
    freedom: float
    """Degrees of freedom behind Σ; inf when it was given."""

    @cached_property
    def solved(self) -> SolvedSystem:
        """The system after its step."""
        flat = self.columns.reshape(-1, self.columns.shape[2])
        scaled = ScaledInformation.of(flat.T @ flat + self.information)
        values, vectors = np.linalg.eigh(scaled.matrix)
        # Combinations that nothing determines do not move: their columns are dependent.
        kept = values > _DETERMINED * values[-1]
        scales = np.where(scaled.scales > 0, scaled.scales, 1.0)
        root = vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None]
        inverse = root @ root.T
        step = inverse @ (flat.T @ self.forces.ravel() + self.gradient)
        return SolvedSystem(self, inverse, root, self.forces - self.columns @ step)

    def with_columns(self, columns: Array) -> JointSystem:
        """Include further columns of the forces, (R, 6, q) in N, among the unknowns."""
        new = columns.shape[2]
        return replace(
            self,
            columns=np.concatenate([self.columns, self.whitened(columns)], axis=2),
            information=np.pad(self.information, (0, new)),
            gradient=np.pad(self.gradient, (0, new)),
        )

    def whitened(self, columns: Array) -> Array:
        """Return columns of the forces, (R, 6, q), as rows of the regression."""
        return whitened(columns, self.white, self.counts)


@dataclass(frozen=True, eq=False)
class SolvedSystem:
    """A system after its step."""

    system: JointSystem
    inverse: Array
    root: Array
    """(u, u) and (u, r), J⁻¹ = root rootᵀ."""
    rest: Array
    """(R, 6), whitened e*."""

    def scores(self, columns: Array) -> tuple[Array, Array, Array]:
        """Return scores, information and zᵀ W z, (q,), of columns, (R, 6, q), one by one."""
        rows, mixed = self._projected(columns)
        whole = np.einsum("nq,nq->q", rows, rows)
        return rows.T @ self.rest.ravel(), whole - np.einsum("qr,qr->q", mixed, mixed), whole

    def fitted(self, columns: Array) -> tuple[Array, Array]:
        """Return the coefficients, (q,), of columns fitted together, and their covariance."""
        rows, mixed = self._projected(columns)
        scaled = ScaledInformation.of(rows.T @ rows - mixed @ mixed.T)
        inverse = np.linalg.inv(scaled.matrix) / np.multiply.outer(scaled.scales, scaled.scales)
        return inverse @ (rows.T @ self.rest.ravel()), inverse

    def _projected(self, columns: Array) -> tuple[Array, Array]:
        """Return the rows of columns and what the unknowns explain of them, (q, r)."""
        rows = self.system.whitened(columns).reshape(self.rest.size, -1)
        return rows, (rows.T @ self.system.columns.reshape(self.rest.size, -1)) @ self.root

    def force_residuals(self) -> Array:
        """Return e*, (R, 6), N."""
        rest = self.rest / np.sqrt(self.system.counts)[:, None]
        return np.asarray(sla.solve_triangular(self.system.white, rest.T, lower=True)).T


def joint_systems(
    parts: Sequence[Linearisation],
    noises: Sequence[NoiseModel],
    known: tuple[Array, Array],
    *,
    held_out: bool,
) -> list[JointSystem]:
    """Build the system of every experiment.

    Parameters
    ----------
    parts, noises : sequence
        Linearised experiments and their noise.
    known : (k, k), (k,)
        Information on the free parameters from outside of the forces and its gradient: the prior
        of an estimate, or Cov(p̂)⁻¹ and zeros for held-out data.
    held_out : bool
        The parameters were not estimated from these experiments: one experiment then tells
        nothing about the residuals of another.
    """
    count = len(known[1])
    lengths = [_length_equations(part, noise) for part, noise in zip(parts, noises, strict=True)]
    own = [
        NormalEquations.of([(part.forces, part.columns, part.counts)], noise.forces.covariance)
        .with_motion(motion)
        .eliminated(count)
        for part, noise, motion in zip(parts, noises, lengths, strict=True)
        if len(parts) > 1 and not held_out
    ]
    systems = []
    for number, (part, noise, motion) in enumerate(zip(parts, noises, lengths, strict=True)):
        others = [each for other, each in enumerate(own) if other != number]
        known_here = known[0] + sum(each.information for each in others)
        gradient = known[1] + sum(each.gradient for each in others)
        white = whitening(noise.forces.covariance)
        systems.append(
            JointSystem(
                white=white,
                counts=part.counts,
                forces=whitened(part.forces, white, part.counts),
                columns=whitened(part.columns, white, part.counts),
                information=np.asarray(sla.block_diag(known_here, motion.matrix)),
                gradient=np.concatenate([gradient, motion.gradient]),
                freedom=noise.forces.freedom,
            )
        )
    return systems


def _length_equations(part: Linearisation, noise: NoiseModel) -> NormalEquations:
    if part.lengths is None:
        return NormalEquations(0.0, np.zeros((0, 0)), np.zeros(0))
    rows = (part.lengths, part.length_columns, part.length_counts)
    return NormalEquations.of([rows], noise.lengths.covariance)
