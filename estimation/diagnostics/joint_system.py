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

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation
from estimation.processing import NoiseModel
from expdesign.information.fisher import whitening


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Whitened rows of one experiment, with what is known of the unknowns from elsewhere.

    Attributes
    ----------
    white : (6, 6)
        S: S Σ Sᵀ = 1.
    weight : (R,)
        Square roots of the rows' counts.
    forces : (R, 6)
        Whitened residuals before the step.
    columns : (R, 6, u)
        Whitened columns of the unknowns (free parameters, motion, effects that were included).
    information, gradient : (u, u), (u,)
        Of the unknowns from the lengths, from other experiments and from priors.
    freedom : float
        Degrees of freedom behind Σ; inf when it was given.
    """

    white: Array
    weight: Array
    forces: Array
    columns: Array
    information: Array
    gradient: Array
    freedom: float

    def solved(self) -> SolvedSystem:
        """Take the step."""
        width = self.columns.shape[2]
        flat = self.columns.reshape(-1, width)
        total = flat.T @ flat + self.information
        right = flat.T @ self.forces.ravel() + self.gradient
        scales = np.sqrt(np.diag(total))
        scales = np.where(scales > 0, scales, 1.0)
        values, vectors = np.linalg.eigh(total / np.multiply.outer(scales, scales))
        # Combinations that nothing determines do not move: their columns are dependent.
        kept = values > 1e-12 * values[-1]
        root = vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None]
        inverse = root @ root.T
        step = inverse @ right
        rest = self.forces - self.columns @ step
        return SolvedSystem(self, inverse, root, step, rest)

    def with_columns(self, columns: Array) -> JointSystem:
        """Include further columns of the forces, (R, 6, q) in N, among the unknowns."""
        added = self.whitened(columns)
        old, new = self.columns.shape[2], columns.shape[2]
        information = np.zeros((old + new, old + new))
        information[:old, :old] = self.information
        return replace(
            self,
            columns=np.concatenate([self.columns, added], axis=2),
            information=information,
            gradient=np.append(self.gradient, np.zeros(new)),
        )

    def whitened(self, columns: Array) -> Array:
        """Return columns of the forces, (R, 6, q), as rows of the regression."""
        return np.matmul(self.white, columns) * self.weight[:, None, None]


@dataclass(frozen=True, eq=False)
class SolvedSystem:
    """A system after its step.

    Attributes
    ----------
    system : JointSystem
    inverse : (u, u)
        J⁻¹.
    root : (u, r)
        J⁻¹ = root rootᵀ.
    step : (u,)
        How far the unknowns moved.
    rest : (R, 6)
        Whitened e*.
    """

    system: JointSystem
    inverse: Array
    root: Array
    step: Array
    rest: Array

    def scores(self, columns: Array) -> tuple[Array, Array, Array]:
        """Test columns one by one: return scores, information and zᵀ W z, (q,) each.

        Parameters
        ----------
        columns : (R, 6, q)
            N per unit of the effect.
        """
        rows = self.system.whitened(columns).reshape(self.rest.size, -1)
        score = rows.T @ self.rest.ravel()
        mixed = (rows.T @ self.system.columns.reshape(self.rest.size, -1)) @ self.root
        whole = np.einsum("nq,nq->q", rows, rows)
        return score, whole - np.einsum("qr,qr->q", mixed, mixed), whole

    def fitted(self, columns: Array) -> tuple[Array, Array]:
        """Fit columns together: return their coefficients (q,) and covariance (q, q)."""
        rows = self.system.whitened(columns).reshape(self.rest.size, -1)
        mixed = (rows.T @ self.system.columns.reshape(self.rest.size, -1)) @ self.root
        information = rows.T @ rows - mixed @ mixed.T
        scales = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.multiply.outer(scales, scales))
        inverse = inverse / np.multiply.outer(scales, scales)
        return inverse @ (rows.T @ self.rest.ravel()), inverse

    def force_residuals(self) -> Array:
        """Return e*, (R, 6), N."""
        rest = self.rest / self.system.weight[:, None]
        return np.asarray(sla.solve_triangular(self.system.white, rest.T, lower=True)).T


@dataclass(frozen=True, eq=False)
class Block:
    """Normal equations of one experiment in (p, ξ)."""

    matrix: Array
    gradient: Array
    count: int

    def reduced(self) -> tuple[Array, Array]:
        """Eliminate ξ: information (k, k) and gradient (k,) of the parameters."""
        k = self.count
        if len(self.gradient) == k:
            return self.matrix, self.gradient
        inner = self.matrix[k:, k:]
        scales = np.sqrt(np.diag(inner))
        factor = sla.cho_factor(inner / np.multiply.outer(scales, scales))
        cross = self.matrix[k:, :k] / scales[:, None]
        solved = sla.cho_solve(factor, np.column_stack([cross, self.gradient[k:] / scales]))
        return (
            self.matrix[:k, :k] - cross.T @ solved[:, :-1],
            self.gradient[:k] - cross.T @ solved[:, -1],
        )


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
    systems = [_own(part, noise) for part, noise in zip(parts, noises, strict=True)]
    reduced = [block.reduced() for _, block in systems]
    result = []
    for number, (system, block) in enumerate(systems):
        information, gradient = system.information.copy(), system.gradient.copy()
        k = block.count
        information[:k, :k] += known[0]
        gradient[:k] += known[1]
        if not held_out:
            for other, (matrix, right) in enumerate(reduced):
                if other != number:
                    information[:k, :k] += matrix
                    gradient[:k] += right
        result.append(replace(system, information=information, gradient=gradient))
    return result


def _own(part: Linearisation, noise: NoiseModel) -> tuple[JointSystem, Block]:
    white = whitening(noise.force_covariance)
    weight = np.sqrt(part.counts)
    columns = np.matmul(white, part.columns) * weight[:, None, None]
    forces = part.forces @ white.T * weight[:, None]
    width = columns.shape[2]
    motion = part.motion_columns.shape[2]
    information, gradient = np.zeros((width, width)), np.zeros(width)
    if part.lengths is not None:
        length_white = whitening(noise.length_covariance)
        length_weight = np.sqrt(part.length_counts)
        rows = np.matmul(length_white, part.length_columns) * length_weight[:, None, None]
        rows = rows.reshape(-1, motion)
        rest = (part.lengths @ length_white.T * length_weight[:, None]).ravel()
        information[width - motion :, width - motion :] = rows.T @ rows
        gradient[width - motion :] = rows.T @ rest
    flat = columns.reshape(-1, width)
    block = Block(flat.T @ flat + information, flat.T @ forces.ravel() + gradient, width - motion)
    system = JointSystem(white, weight, forces, columns, information, gradient, noise.force_freedom)
    return system, block
