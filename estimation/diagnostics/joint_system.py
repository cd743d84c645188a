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
from estimation.diagnostics.row_whitening import RowWhitening
from estimation.diagnostics.signature import Signature
from estimation.measurement_model.normal_equations import NormalEquations
from estimation.processing import NoiseModel
from expdesign.information.fisher import ScaledInformation
from expdesign.mechanism.hexapod import ACTUATORS

_DETERMINED = 1e-12
"""Eigenvalues of the scaled J below this share of the largest belong to dependent columns."""


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Whitened rows of one experiment, with what is known of the unknowns from elsewhere."""

    force_rows: RowWhitening
    length_rows: RowWhitening
    forces: Array
    columns: Array
    """(R, 6) and (R, 6, u), whitened: residuals before the step; columns of the unknowns (free
    parameters, motion, effects that were included)."""
    information: Array
    gradient: Array
    """(u, u) and (u,), of the unknowns from the lengths, from other experiments and from priors."""
    freedom: float
    """Degrees of freedom behind Σ; inf when it was given."""
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

    def with_effects(self, effects: Signature, precision: Array | None = None) -> JointSystem:
        """Include effects among the unknowns, known to 1/std², (q,), or not at all."""
        forces, lengths = self.whitened(effects)
        new = lengths.reshape(self.lengths.size, effects.count)
        known = self.length_columns.reshape(self.lengths.size, len(self.gradient))
        cross = known.T @ new
        own = new.T @ new
        if precision is not None:
            own += np.diag(precision)
        return replace(
            self,
            columns=np.concatenate([self.columns, forces], axis=2),
            length_columns=np.concatenate([self.length_columns, lengths], axis=2),
            information=np.block([[self.information, cross], [cross.T, own]]),
            gradient=np.concatenate([self.gradient, new.T @ self.lengths.ravel()]),
        )

    def of_lengths(self, first: int, precision: Array) -> JointSystem:
        """Return what the lengths alone say of the unknowns from `first` on, which move them.

        They are known to `precision`, 1/std² of each, beside these data.
        """
        columns = self.length_columns[:, :, first:]
        return replace(
            self,
            force_rows=self.length_rows,
            forces=self.lengths,
            columns=columns,
            information=np.diag(precision),
            gradient=np.zeros(len(precision)),
            lengths=self.lengths[:0],
            length_columns=columns[:0],
        )

    def whitened(self, effects: Signature) -> tuple[Array, Array]:
        """Return effects as rows of the regression: of the forces, and of the lengths."""
        return self.force_rows(effects.forces), self.length_rows(effects.lengths)


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
        """Return e*, (R, 6), N, behind the filter."""
        return self.system.force_rows.unscaled(self.rest)


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
    force_rows = [
        RowWhitening.of(noise.forces, part.counts)
        for part, noise in zip(parts, noises, strict=True)
    ]
    length_rows = [
        RowWhitening.of(noise.lengths, part.length_counts)
        for part, noise in zip(parts, noises, strict=True)
    ]
    measured = [
        _length_equations(part, rows) for part, rows in zip(parts, length_rows, strict=True)
    ]
    own = [
        rows.equations(part.forces, part.columns).with_motion(motion).eliminated(count)
        for part, rows, motion in zip(parts, force_rows, measured, strict=True)
        if len(parts) > 1 and not held_out
    ]
    systems = []
    for number, (part, noise, motion, of_forces, of_lengths) in enumerate(
        zip(parts, noises, measured, force_rows, length_rows, strict=True)
    ):
        others = [each for other, each in enumerate(own) if other != number]
        known_here = known[0] + sum(each.information for each in others)
        gradient = known[1] + sum(each.gradient for each in others)
        unknowns = part.columns.shape[2]
        lengths = np.zeros((0, ACTUATORS)) if part.lengths is None else part.lengths
        length_columns = np.zeros((len(lengths), ACTUATORS, unknowns))
        length_columns[:, :, count:] = part.length_columns
        systems.append(
            JointSystem(
                force_rows=of_forces,
                length_rows=of_lengths,
                forces=of_forces(part.forces),
                columns=of_forces(part.columns),
                information=np.asarray(sla.block_diag(known_here, motion.matrix)),
                gradient=np.concatenate([gradient, motion.gradient]),
                freedom=noise.forces.weights_freedom,
                lengths=of_lengths(lengths) if len(lengths) else lengths,
                length_columns=of_lengths(length_columns) if len(lengths) else length_columns,
            )
        )
    return systems


def _length_equations(part: Linearisation, rows: RowWhitening) -> NormalEquations:
    if part.lengths is None:
        return NormalEquations(0.0, np.zeros((0, 0)), np.zeros(0))
    return rows.equations(part.lengths, part.length_columns)
