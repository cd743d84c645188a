"""The linear regression behind all tests of the model: forces and lengths together, whitened.

One Gauss–Newton step in (p, ξ) takes the residuals of any estimator to where the model explains as
much of them as it can. What is left, e*, has the covariance W⁻¹ − U J⁻¹ Uᵀ whatever the estimator
was. A further column z is tested by its score s = zᵀ W e* with the information
I = zᵀ W z − zᵀ W U J⁻¹ Uᵀ W z: its coefficient is I⁻¹ s, and sᵀ I⁻¹ s is χ² if there is none. A
column has rows in the forces and in the lengths (`Signature`).

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
from estimation.diagnostics.projection import Fit, Projection
from estimation.diagnostics.signature import Signature
from estimation.measurement_model.normal_equations import NormalEquations, whitened
from estimation.processing import NoiseModel
from expdesign.information.fisher import ScaledInformation, whitening
from expdesign.mechanism.hexapod import ACTUATORS

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
    length_white: Array
    length_counts: Array
    """As of the forces: (6, 6), (R',)."""
    lengths: Array
    length_columns: Array
    """(R', 6) and (R', 6, u), whitened, likewise; what they say of the unknowns is part of
    `information` and `gradient` already."""

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
        return SolvedSystem(
            self,
            inverse,
            root,
            self.forces - self.columns @ step,
            self.lengths - self.length_columns @ step,
        )

    def with_effects(self, effects: Signature) -> JointSystem:
        """Include effects among the unknowns."""
        forces, lengths = self.whitened(effects)
        new = lengths.reshape(self.lengths.size, effects.count)
        known = self.length_columns.reshape(self.lengths.size, len(self.gradient))
        cross = known.T @ new
        return replace(
            self,
            columns=np.concatenate([self.columns, forces], axis=2),
            length_columns=np.concatenate([self.length_columns, lengths], axis=2),
            information=np.block([[self.information, cross], [cross.T, new.T @ new]]),
            gradient=np.concatenate([self.gradient, new.T @ self.lengths.ravel()]),
        )

    def whitened(self, effects: Signature) -> tuple[Array, Array]:
        """Return effects as rows of the regression: of the forces, and of the lengths."""
        return (
            whitened(effects.forces, self.white, self.counts),
            whitened(effects.lengths, self.length_white, self.length_counts),
        )


@dataclass(frozen=True, eq=False)
class SolvedSystem:
    """A system after its step."""

    system: JointSystem
    inverse: Array
    root: Array
    """(u, u) and (u, r), J⁻¹ = root rootᵀ."""
    rest: Array
    length_rest: Array
    """(R, 6) and (R', 6), whitened e* of forces and lengths."""

    def projection(self, effects: Signature) -> Projection:
        """Return what the data say of effects beyond the unknowns."""
        system = self.system
        rows = [
            part.reshape(rest.size, effects.count)
            for part, rest in zip(
                system.whitened(effects), (self.rest, self.length_rest), strict=True
            )
        ]
        columns = (system.columns, system.length_columns)
        mixed = sum(
            part.T @ unknown.reshape(len(part), unknown.shape[2])
            for part, unknown in zip(rows, columns, strict=True)
        )
        rest = np.concatenate([self.rest.ravel(), self.length_rest.ravel()])
        return Projection(np.concatenate(rows), mixed @ self.root, rest, system.freedom)

    def fitted(self, effects: Signature) -> Fit:
        """Fit effects together."""
        return self.projection(effects).beside(()).fit(range(effects.count))

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
    measured = [_length_equations(part, noise) for part, noise in zip(parts, noises, strict=True)]
    own = [
        NormalEquations.of([(part.forces, part.columns, part.counts)], noise.forces.covariance)
        .with_motion(motion)
        .eliminated(count)
        for part, noise, motion in zip(parts, noises, measured, strict=True)
        if len(parts) > 1 and not held_out
    ]
    systems = []
    for number, (part, noise, motion) in enumerate(zip(parts, noises, measured, strict=True)):
        others = [each for other, each in enumerate(own) if other != number]
        known_here = known[0] + sum(each.information for each in others)
        gradient = known[1] + sum(each.gradient for each in others)
        white = whitening(noise.forces.covariance)
        length_white = whitening(noise.lengths.covariance)
        unknowns = part.columns.shape[2]
        lengths = np.zeros((0, ACTUATORS)) if part.lengths is None else part.lengths
        length_columns = np.zeros((len(lengths), ACTUATORS, unknowns))
        length_columns[:, :, count:] = part.length_columns
        systems.append(
            JointSystem(
                white=white,
                counts=part.counts,
                forces=whitened(part.forces, white, part.counts),
                columns=whitened(part.columns, white, part.counts),
                information=np.asarray(sla.block_diag(known_here, motion.matrix)),
                gradient=np.concatenate([gradient, motion.gradient]),
                freedom=noise.forces.freedom,
                length_white=length_white,
                length_counts=part.length_counts,
                lengths=whitened(lengths, length_white, part.length_counts),
                length_columns=whitened(length_columns, length_white, part.length_counts),
            )
        )
    return systems


def _length_equations(part: Linearisation, noise: NoiseModel) -> NormalEquations:
    if part.lengths is None:
        return NormalEquations(0.0, np.zeros((0, 0)), np.zeros(0))
    rows = (part.lengths, part.length_columns, part.length_counts)
    return NormalEquations.of([rows], noise.lengths.covariance)
