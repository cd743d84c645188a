"""Joint whitened regression of forces and lengths, the basis of all tests of the model.

One Gauss–Newton step in (p, ξ) minimises the residuals of any estimator within the model. The
remaining residuals e* have the covariance W⁻¹ − U J⁻¹ Uᵀ, independently of the estimator. A further
column z is tested by its score s = zᵀ W e* with the information I = zᵀ W z − zᵀ W U J⁻¹ Uᵀ W z: its
coefficient is I⁻¹ s, and without such an effect sᵀ I⁻¹ s follows χ². A column has rows in the
forces and in the lengths (`Signature`).

For held-out data the parameters are not fitted: they have the prior information Cov(p̂)⁻¹.

Scores s and information I of all candidate effects (`EffectProjection`) suffice to fit every subset
of them: conditional on the effects S, the effects C have

    s_C − I_CS I_SS⁻¹ s_S,   I_CC − I_CS I_SS⁻¹ I_SC,

so that subsets are fitted and compared without returning to the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.measurement_model.motion import (
    NormalEquations,
    root_of_pseudo_inverse,
    whiten_rows,
)
from estimation.processing import NoiseEstimate, NoiseModel
from estimation.processing.spectrum import WhiteningFilter
from expdesign.information.fisher import whitening
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity

DETERMINED = 1e-12
"""Smallest eigenvalue of the scaled J, relative to the largest, of independent columns."""

SEEN = 1e-6
"""Smallest share of an effect's information that must remain given all other unknowns."""
Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Whitened rows of one experiment, with the other information on its unknowns."""

    force_rows: RowWhitening
    length_rows: RowWhitening
    forces: Array
    columns: Array
    """(R, 6) and (R, 6, u), whitened: residuals before the step; columns of the unknowns (free
    parameters, motion, signs of friction, included effects)."""
    information: Array
    gradient: Array
    """(u, u) and (u,), information on the unknowns from lengths, other experiments and priors."""
    freedom: float
    """Degrees of freedom of Σ; inf if it was given."""
    lengths: Array
    length_columns: Array
    """(R', 6) and (R', 6, u), whitened residuals and columns of the lengths; `information` and
    `gradient` already include them."""
    others: NormalEquations | None = None
    """Information of the other experiments on the free parameters and the deviations with
    tolerances, of which `information` and `gradient` include the part on the parameters; None:
    there is no other experiment."""

    @cached_property
    def solution(self) -> SolvedSystem:
        """System after the Gauss–Newton step."""
        flat = self.columns.reshape(-1, self.columns.shape[2])
        # Undetermined combinations keep their values: their columns are dependent.
        root = root_of_pseudo_inverse(flat.T @ flat + self.information, DETERMINED)
        inverse = root @ root.T
        step = inverse @ (flat.T @ self.forces.ravel() + self.gradient)
        return SolvedSystem(
            self,
            inverse,
            root,
            self.forces - self.columns @ step,
            self.lengths - self.length_columns @ step,
        )

    def with_effects(
        self, effects: Signature, precision: Array | None = None, off: Array | None = None
    ) -> JointSystem:
        """Include effects among the unknowns.

        `precision`, (q,), are their prior precisions 1/std²; `off`, (q,), the prior means less the
        values at which the rows were linearised, zero by default.
        """
        forces, lengths = self.whiten(effects)
        new = lengths.reshape(self.lengths.size, effects.count)
        known = self.length_columns.reshape(self.lengths.size, len(self.gradient))
        cross = known.T @ new
        own, gradient = new.T @ new, new.T @ self.lengths.ravel()
        if precision is not None:
            own += np.diag(precision)
            gradient += 0.0 if off is None else precision * off
        return replace(
            self,
            columns=np.concatenate([self.columns, forces], axis=2),
            length_columns=np.concatenate([self.length_columns, lengths], axis=2),
            information=np.block([[self.information, cross], [cross.T, own]]),
            gradient=np.concatenate([self.gradient, gradient]),
        )

    def with_tolerances(self, deviations: Signature, precision: Array, off: Array) -> JointSystem:
        """Include deviations with tolerances, common to all experiments, among the unknowns.

        `precision` and `off`, (t,), are those of `with_effects`.
        """
        found = self.with_effects(deviations, precision, off)
        if self.others is None:
            return found
        parameters = len(self.others.gradient) - deviations.count
        places = np.r_[0:parameters, len(self.gradient) : len(found.gradient)]
        matrix, gradient = self.others.matrix.copy(), self.others.gradient.copy()
        matrix[:parameters, :parameters], gradient[:parameters] = 0.0, 0.0
        found.information[np.ix_(places, places)] += matrix
        found.gradient[places] += gradient
        return found

    def select(self, unknowns: Places) -> JointSystem:
        """Return the system of some unknowns; the others keep their values."""
        return replace(
            self,
            columns=self.columns[:, :, unknowns],
            length_columns=self.length_columns[:, :, unknowns],
            information=self.information[np.ix_(unknowns, unknowns)],
            gradient=self.gradient[unknowns],
        )

    def restrict_to_lengths(self, first: int, precision: Array) -> JointSystem:
        """Return the system of the lengths alone, for the unknowns from `first` on.

        `precision`, 1/std² of each, is their prior information.
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

    def whiten(self, effects: Signature) -> tuple[Array, Array]:
        """Whiten effects: their rows in the forces and in the lengths."""
        return self.force_rows(effects.forces), self.length_rows(effects.lengths)


@dataclass(frozen=True, eq=False)
class SolvedSystem:
    """System after its Gauss–Newton step."""

    system: JointSystem
    inverse: Array
    root: Array
    """(u, u) and (u, r), J⁻¹ = root rootᵀ."""
    rest: Array
    length_rest: Array
    """(R, 6) and (R', 6), whitened e* of forces and lengths."""

    def project(self, effects: Signature) -> EffectProjection:
        """Project effects onto the part that the unknowns do not explain."""
        system = self.system
        rows = [
            part.reshape(rest.size, effects.count)
            for part, rest in zip(
                system.whiten(effects), (self.rest, self.length_rest), strict=True
            )
        ]
        columns = (system.columns, system.length_columns)
        mixed = sum(
            part.T @ unknown.reshape(len(part), unknown.shape[2])
            for part, unknown in zip(rows, columns, strict=True)
        )
        rest = np.concatenate([self.rest.ravel(), self.length_rest.ravel()])
        return EffectProjection(np.concatenate(rows), mixed @ self.root, rest, system.freedom)

    def fit(self, effects: Signature) -> EffectFit:
        """Fit effects jointly."""
        return self.project(effects).conditional_on(()).fit(range(effects.count))

    def force_residuals(self) -> Array:
        """Return e*, (R, 6), N, after the filter."""
        return self.system.force_rows.unscale(self.rest)


def joint_systems(
    parts: Sequence[Linearisation],
    noises: Sequence[NoiseModel],
    known: NormalEquations,
    deviations: Sequence[Signature],
    *,
    held_out: bool,
) -> list[JointSystem]:
    """Build the system of every experiment.

    Parameters
    ----------
    parts, noises : sequence
        Linearised experiments and their noise.
    known : NormalEquations
        Prior information on the free parameters: the prior of an estimate, or Cov(p̂)⁻¹ without a
        gradient for held-out data.
    deviations : sequence of Signature
        Columns of the deviations with tolerances, the same in all experiments.
    held_out : bool
        The parameters were not estimated from these experiments, so that they carry no information
        on each other's residuals.
    """
    count = len(known.gradient)
    force_rows = [
        RowWhitening.of(noise.forces, part.counts)
        for part, noise in zip(parts, noises, strict=True)
    ]
    length_rows = [
        RowWhitening.of(noise.lengths, part.length_counts)
        for part, noise in zip(parts, noises, strict=True)
    ]
    tolerated = deviations[0].count
    measured = [
        _length_equations(part, rows, own)
        for part, rows, own in zip(parts, length_rows, deviations, strict=True)
    ]
    shares: list[NormalEquations] = [
        rows.equations(part.forces, np.insert(part.columns, [count], own.forces, axis=2))
        .with_motion(motion)
        .eliminate(count + tolerated)
        for part, rows, own, motion in zip(parts, force_rows, deviations, measured, strict=True)
        if len(parts) > 1 and not held_out
    ]
    systems = []
    for number, (part, noise, length_share, of_forces, of_lengths) in enumerate(
        zip(parts, noises, measured, force_rows, length_rows, strict=True)
    ):
        motion, own, others = length_share.select(slice(tolerated, None)), known, None
        if shares:
            others = reduce(NormalEquations.__add__, shares[:number] + shares[number + 1 :])
            own = known + others.select(slice(count))
        unknowns = part.columns.shape[2]
        lengths = np.zeros((0, ACTUATORS)) if part.lengths is None else part.lengths
        length_columns = np.zeros((len(lengths), ACTUATORS, unknowns))
        length_columns[:, :, count : count + part.length_columns.shape[2]] = part.length_columns
        systems.append(
            JointSystem(
                force_rows=of_forces,
                length_rows=of_lengths,
                forces=of_forces(part.forces),
                columns=of_forces(part.columns),
                information=np.asarray(sla.block_diag(own.matrix, motion.matrix)),
                gradient=np.concatenate([own.gradient, motion.gradient]),
                freedom=noise.forces.weights_freedom,
                lengths=of_lengths(lengths) if len(lengths) else lengths,
                length_columns=of_lengths(length_columns) if len(lengths) else length_columns,
                others=others,
            )
        )
    return systems


def _length_equations(
    part: Linearisation, rows: RowWhitening, deviations: Signature
) -> NormalEquations:
    """Return the lengths' equations of deviations, motion and signs, with the signs' variance."""
    signs = part.sign_precision
    if part.lengths is None:
        return NormalEquations(0.0, np.diag(signs), np.zeros(len(signs)))
    columns = np.concatenate([deviations.lengths, part.length_columns], axis=2)
    found = rows.equations(part.lengths, np.pad(columns, ((0, 0), (0, 0), (0, len(signs)))))
    prior = np.concatenate([np.zeros(columns.shape[2]), signs])
    return replace(found, matrix=found.matrix + np.diag(prior))


@dataclass(frozen=True, eq=False)
class RowWhitening:
    """Scaling of the rows of forces or lengths to unit covariance."""

    white: Array
    """(6, 6), S with S Σ Sᵀ = 1; Σ is increased by the loss due to its estimation."""
    counts: Array
    """(R,), number of samples averaged in each row."""
    filter: WhiteningFilter | None
    """Filter applied first, if the noise is coloured."""

    @classmethod
    def of(cls, noise: NoiseEstimate, counts: Array) -> RowWhitening:
        """Build the scaling from the noise of one sample."""
        white = whitening(noise.covariance * noise.weighting_loss)
        return cls(white, counts, noise.filter)

    def __call__(self, values: Array) -> Array:
        """Whiten residuals, (R, 6), or columns, (R, 6, q)."""
        rows = values if self.filter is None else self.filter(values)
        return whiten_rows(rows, self.white, self.counts)

    def equations(self, residuals: Array, columns: Array) -> NormalEquations:
        """Return the normal equations of residuals, (R, 6), and their columns, (R, 6, u)."""
        rest, rows = self(residuals).ravel(), self(columns).reshape(residuals.size, -1)
        return NormalEquations(float(rest @ rest), rows.T @ rows, rows.T @ rest)

    def unscale(self, rows: Array) -> Array:
        """Return whitened rows, (R, 6) or (R, 6, q), in N or m; they remain filtered."""
        flat = rows.reshape(*rows.shape[:2], -1) / np.sqrt(self.counts)[:, None, None]
        return np.asarray(np.linalg.solve(self.white, flat)).reshape(rows.shape)

    def apply_weights(self, rows: Array) -> Array:
        """Return the weighted rows, (R, 6, q), for inner products with unwhitened columns.

        zᵀ times the result is zᵀ W u, for a column z and the whitened rows of u.
        """
        values = np.matmul(self.white.T, rows) * np.sqrt(self.counts)[:, None, None]
        return values if self.filter is None else self.filter.adjoint(values)

    def quadratic(self, actuator: int) -> Callable[[Array, Array], Array]:
        """Return a function for zᵀ W y of pairs of series in one actuator, (q, R) each: (q,)."""
        if self.filter is None:
            column = self.white[:, actuator]
            weight = float(column @ column) * self.counts
            return lambda z, y: (z * y) @ weight
        noise_filter, count = self.filter, float(self.counts[0])
        gains = np.linalg.norm(self.white @ noise_filter.gain[:, :, actuator].T, axis=0) ** 2
        weights = count * gains * multiplicity(noise_filter.samples)
        size = 1.0 if noise_filter.size is None else noise_filter.size[:, actuator]
        return lambda z, y: weights @ (lines_of((z / size).T).conj() * lines_of((y / size).T)).real


@dataclass(frozen=True, eq=False)
class EffectProjection:
    """Whitened rows of q effects, and their part explained by the unknowns."""

    rows: Array
    """(n, q)."""
    mixed: Array
    """(q, r), zᵀ U root, with J⁻¹ = root rootᵀ."""
    rest: Array
    """(n,), whitened e*."""
    freedom: float
    """Degrees of freedom of Σ; inf if it was given."""

    @cached_property
    def score(self) -> Array:
        """(q,), s."""
        return self.rows.T @ self.rest

    @cached_property
    def gram(self) -> Array:
        """(q, q), zᵀ z."""
        return self.rows.T @ self.rows

    @cached_property
    def information(self) -> Array:
        """(q, q), I."""
        return self.gram - self.mixed @ self.mixed.T

    def append(self, other: EffectProjection) -> EffectProjection:
        """Append effects of the same system, keeping computed products."""
        appended = EffectProjection(
            np.concatenate([self.rows, other.rows], axis=1),
            np.concatenate([self.mixed, other.mixed]),
            self.rest,
            self.freedom,
        )
        cross = self.rows.T @ other.rows
        # The cached properties take the products that are already known.
        appended.__dict__["gram"] = np.block([[self.gram, cross], [cross.T, other.gram]])
        appended.__dict__["score"] = np.concatenate([self.score, other.score])
        return appended

    def conditional_on(self, known: Sequence[int] | Places) -> ConditionalScores:
        """Return scores and information conditional on the effects at some indices."""
        everything = ConditionalScores(
            self.score, self.information, np.diag(self.gram), self.freedom
        )
        return everything.conditional_on(known)


@dataclass(frozen=True, eq=False)
class ConditionalScores:
    """Scores and information of q effects, conditional on some others."""

    score: Array
    information: Array
    """(q,) and (q, q)."""
    whole: Array
    """(q,), zᵀ z."""
    freedom: float

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """(q,), effects with enough remaining information, each on its own."""
        return np.diag(self.information) > SEEN * np.where(self.whole > 0, self.whole, np.inf)

    def conditional_on(self, known: Sequence[int] | Places) -> ConditionalScores:
        """Return scores and information conditional also on the effects at some indices."""
        places = np.asarray(known, dtype=np.intp)
        if not len(places):
            return self
        root, _ = _root(self.information[np.ix_(places, places)], self.whole[places])
        explained = self.information[:, places] @ root
        return ConditionalScores(
            self.score - explained @ (root.T @ self.score[places]),
            self.information - explained @ explained.T,
            self.whole,
            self.freedom,
        )

    def select(self, places: Places) -> ConditionalScores:
        """Return scores and information of the effects at some indices."""
        own = np.ix_(places, places)
        return replace(
            self,
            score=self.score[places],
            information=self.information[own],
            whole=self.whole[places],
        )

    def fit(self, places: Sequence[int] | Places, seen: float = SEEN) -> EffectFit:
        """Fit the effects at some indices jointly.

        Combinations of which less than the share `seen` remains are left out.
        """
        chosen = np.asarray(places, dtype=np.intp)
        root, rank = _root(self.information[np.ix_(chosen, chosen)], self.whole[chosen], seen)
        part = root.T @ self.score[chosen]
        return EffectFit(float(part @ part), rank, root @ part, root @ root.T)


@dataclass(frozen=True, eq=False)
class EffectFit:
    """Joint fit of some effects."""

    statistic: float
    """χ² of the hypothesis of no effects (ν-fold with an estimated Σ)."""
    rank: int
    """Its degrees of freedom: number of identifiable combinations."""
    values: Array
    covariance: Array
    """(k,) and (k, k), in the units of the effects."""


def _root(information: Array, whole: Array, seen: float = SEEN) -> tuple[Array, int]:
    """Return R with R Rᵀ = I⁺ on the identifiable combinations, and their number."""
    scales = np.sqrt(np.where(whole > 0, whole, 1.0))
    values, vectors = np.linalg.eigh(information / np.multiply.outer(scales, scales))
    kept = values > seen
    return vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None], int(np.count_nonzero(kept))
