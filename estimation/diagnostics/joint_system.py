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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.whitened_rows import Places, RowWhitening, SignElimination
from estimation.measurement_model.motion import NormalEquations, root_of_pseudo_inverse
from estimation.processing import NoiseModel
from expdesign.mechanism.hexapod import ACTUATORS

DETERMINED = 1e-12
"""Smallest eigenvalue of the scaled J, relative to the largest, of independent columns."""

SEEN = 1e-6
"""Smallest share of an effect's information that must remain given all other unknowns."""


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Whitened rows of one experiment, first the forces', with their normal equations.

    The unknowns are free parameters, motion, and included effects; unknown signs of friction are
    eliminated, and their priors add the last rows.
    """

    force_rows: RowWhitening
    length_rows: RowWhitening
    residuals: Array
    columns: Array
    """(n,) and (n, u), whitened: residuals before the step; columns of the unknowns."""
    equations: NormalEquations
    """Of these rows, the other experiments and the priors."""
    freedom: float
    """Degrees of freedom of Σ; inf if it was given."""
    signs: SignElimination | None = None
    """Of the unknown signs of friction; None: there are none."""
    others: NormalEquations | None = None
    """Information of the other experiments on the free parameters and the deviations with
    tolerances, of which `equations` include the part on the parameters; None: there is no other
    experiment."""

    @classmethod
    def of(cls, part: Linearisation, noise: NoiseModel) -> JointSystem:
        """Build the system of one experiment, without information on the parameters."""
        known = int(np.count_nonzero(part.free))
        lengths = np.zeros((0, ACTUATORS)) if part.lengths is None else part.lengths
        rows = (
            RowWhitening.of(noise.forces, part.counts),
            RowWhitening.of(noise.lengths, part.length_counts),
        )
        signs = None
        if len(part.sign_precision):
            signs = SignElimination.of(rows[0], part.sign_errors, part.sign_precision)
        residuals, columns = (
            _eliminate(signs, _whiten(rows, each, signs))
            for each in (
                Signature(part.forces[:, :, None], lengths[:, :, None]),
                Signature(part.columns, np.pad(part.length_columns, ((0, 0), (0, 0), (known, 0)))),
            )
        )
        precision, freedom = np.zeros(columns.shape[1]), noise.forces.weights_freedom
        system = cls.of_rows(rows, residuals[:, 0], columns, precision, freedom)
        return replace(system, signs=signs)

    @classmethod
    def of_rows(
        cls,
        rows: tuple[RowWhitening, RowWhitening],
        residuals: Array,
        columns: Array,
        precision: Array,
        freedom: float,
    ) -> JointSystem:
        """Build a system with prior precisions of the unknowns, (u,), 1/std²."""
        matrix = columns.T @ columns + np.diag(precision)
        equations = NormalEquations(0.0, matrix, columns.T @ residuals)
        return cls(*rows, residuals, columns, equations, freedom)

    @cached_property
    def solution(self) -> SolvedSystem:
        """System after the Gauss–Newton step."""
        # Undetermined combinations keep their values: their columns are dependent.
        root = root_of_pseudo_inverse(self.equations.matrix, DETERMINED)
        step = root @ (root.T @ self.equations.gradient)
        return SolvedSystem(self, root, self.residuals - self.columns @ step)

    def with_effects(
        self, effects: Signature, precision: Array | None = None, off: Array | None = None
    ) -> JointSystem:
        """Include effects among the unknowns.

        `precision`, (q,), are their prior precisions 1/std²; `off`, (q,), the prior means less the
        values at which the rows were linearised, zero by default.
        """
        new = self.eliminate_signs(self.whiten(effects))
        cross, own, gradient = self.columns.T @ new, new.T @ new, new.T @ self.residuals
        if precision is not None:
            own += np.diag(precision)
            gradient += 0.0 if off is None else precision * off
        return replace(
            self,
            columns=np.concatenate([self.columns, new], axis=1),
            equations=NormalEquations(
                0.0,
                np.block([[self.equations.matrix, cross], [cross.T, own]]),
                np.concatenate([self.equations.gradient, gradient]),
            ),
        )

    def with_tolerances(self, deviations: Signature, precision: Array, off: Array) -> JointSystem:
        """Include deviations with tolerances, common to all experiments, among the unknowns.

        `precision` and `off`, (t,), are those of `with_effects`.
        """
        found = self.with_effects(deviations, precision, off)
        if self.others is None:
            return found
        parameters = len(self.others.gradient) - deviations.count
        places = motion_last(found, parameters, deviations.count)[: len(self.others.gradient)]
        matrix, gradient = self.others.matrix.copy(), self.others.gradient.copy()
        matrix[:parameters, :parameters], gradient[:parameters] = 0.0, 0.0
        found.equations.matrix[np.ix_(places, places)] += matrix
        found.equations.gradient[places] += gradient
        return found

    def select(self, unknowns: Places) -> JointSystem:
        """Return the system of some unknowns; the others keep their values."""
        equations = self.equations.select(unknowns)
        return replace(self, columns=self.columns[:, unknowns], equations=equations)

    def restrict_to_lengths(self, first: int, precision: Array) -> JointSystem:
        """Return the system of the lengths without the forces, from an unknown on.

        `precision`, 1/std² of each unknown, is its prior information.
        """
        rows = self.length_rows, replace(self.length_rows, counts=np.zeros(0))
        own = slice(ACTUATORS * len(self.force_rows.counts), ACTUATORS * self._samples)
        residuals, columns = self.residuals[own], self.columns[own, first:]
        return JointSystem.of_rows(rows, residuals, columns, precision, self.freedom)

    def whiten(self, effects: Signature) -> Array:
        """Return the rows of effects, (n, q), before signs are eliminated from them."""
        return _whiten((self.force_rows, self.length_rows), effects, self.signs)

    def whiten_forces(self, columns: Array) -> Array:
        """Return the rows of columns in the forces, (R, 6, q), without those of the lengths."""
        rows = self.force_rows, replace(self.length_rows, counts=np.zeros(0))
        return _whiten(rows, Signature(columns, np.zeros((0, *columns.shape[1:]))), self.signs)

    def eliminate_signs(self, rows: Array) -> Array:
        """Eliminate the unknown signs of friction from the rows of effects, (n, q), in place."""
        return _eliminate(self.signs, rows)

    def products(self, rows: Array, in_lengths: Places) -> Array:
        """Return zᵀ U of the rows of effects, (n, q), of which some change lengths: (q, u)."""
        first, last = ACTUATORS * len(self.force_rows.counts), ACTUATORS * self._samples
        found = rows[:first].T @ self.columns[:first] + rows[last:].T @ self.columns[last:]
        found[in_lengths] += rows[first:last, in_lengths].T @ self.columns[first:last]
        return found

    @property
    def _samples(self) -> int:
        """Number R + R' of samples of forces and lengths."""
        return len(self.force_rows.counts) + len(self.length_rows.counts)

    def split(self, rows: Array) -> tuple[Array, Array]:
        """Split rows, (n, …), into those of the forces, (R, 6, …), and of the lengths."""
        count = len(self.force_rows.counts)
        measured = rows[: ACTUATORS * self._samples]
        whole = measured.reshape(self._samples, ACTUATORS, *rows.shape[1:])
        return whole[:count], whole[count:]


def _whiten(
    rows: tuple[RowWhitening, RowWhitening], effects: Signature, signs: SignElimination | None
) -> Array:
    """Return the whitened forces and lengths of effects, and rows of zeros for signs, (n, q)."""
    counts = [ACTUATORS * len(each.counts) for each in rows]
    found = np.zeros((sum(counts) + (0 if signs is None else signs.count), effects.count))
    forces, lengths, seen = rows[0](effects.forces), effects.lengths, effects.in_lengths
    found[: counts[0]] = forces.reshape(counts[0], effects.count)
    if len(seen):  # in one piece, which is not copied
        among = slice(seen[0], seen[-1] + 1)
        own = rows[1](lengths[:, :, among])
        found[counts[0] : sum(counts), among] = own.reshape(counts[1], own.shape[2])
    return found


def _eliminate(signs: SignElimination | None, rows: Array) -> Array:
    return rows if signs is None else signs(rows)


def motion_last(system: JointSystem, parameters: int, effects: int) -> Places:
    """Return the unknowns in the order parameters, effects included last, motion."""
    size = len(system.equations.gradient)
    return np.r_[0:parameters, size - effects : size, parameters : size - effects]


@dataclass(frozen=True, eq=False)
class SolvedSystem:
    """System after its Gauss–Newton step."""

    system: JointSystem
    root: Array
    """(u, r), J⁻¹ = root rootᵀ."""
    rest: Array
    """(n,), whitened e*."""

    @cached_property
    def inverse(self) -> Array:
        """(u, u), J⁻¹."""
        return self.root @ self.root.T

    @property
    def force_rest(self) -> Array:
        """(R, 6), whitened e* of the forces."""
        return self.system.split(self.rest)[0]

    def project(self, effects: Signature) -> EffectProjection:
        """Project effects onto the part that the unknowns do not explain."""
        rows = self.system.whiten(effects)
        whole = np.einsum("nq,nq->q", rows, rows)
        self.system.eliminate_signs(rows)
        products = self.system.products(rows, effects.in_lengths)
        mixed = products @ self.root
        return EffectProjection(rows, products, mixed, whole, self.rest, self.system.freedom)

    def with_effects(self, effects: Signature) -> SolvedSystem:
        """Include effects among the unknowns."""
        if not effects.count:
            return self
        found, system = self.project(effects), self.system
        # The inverse of a matrix with further rows and columns, from that of the first ones.
        root, _ = _root(found.information, found.whole)
        others = self.root @ (found.mixed.T @ root)
        nothing = np.zeros((effects.count, self.root.shape[1]))
        left = found.rows @ root - system.columns @ others
        solved = SolvedSystem(
            system.with_effects(effects),
            np.block([[self.root, -others], [nothing, root]]),
            self.rest - left @ (root.T @ found.score),
        )
        if "force_roots" in self.__dict__:
            whole = np.concatenate([self.force_roots, system.split(left)[0]], axis=2)
            solved.__dict__["force_roots"] = whole
        return solved

    def fit(self, effects: Signature) -> EffectFit:
        """Fit effects jointly."""
        return self.project(effects).conditional_on(()).fit(range(effects.count))

    def force_residuals(self) -> Array:
        """Return e*, (R, 6), N, after the filter."""
        return self.system.force_rows.unscale(self.force_rest)

    @cached_property
    def force_roots(self) -> Array:
        """(R, 6, r), whitened columns of the forces, times the root."""
        system, first = self.system, ACTUATORS * len(self.system.force_rows.counts)
        return (system.columns[:first] @ self.root).reshape(-1, ACTUATORS, self.root.shape[1])

    @cached_property
    def explained(self) -> Array:
        """(6, R, r), factors F: of a column z in the forces Σ |zᵀ F|² is explained, of zᵀ W z."""
        weighted = self.system.force_rows.apply_weights(self.force_roots)
        return np.ascontiguousarray(weighted.transpose(1, 0, 2))

    @cached_property
    def weighted_rest(self) -> Array:
        """(R, 6), W e*: the score of a column z in the forces is zᵀ W e*."""
        return self.system.force_rows.apply_weights(self.force_rest[:, :, None])[:, :, 0]

    def explain(self, actuator: int, waves: Array) -> Array:
        """Return zᵀ F of columns in one actuator, (q, R), with those of unknown signs, (q, r)."""
        own, signs = waves @ self.explained[actuator], self.system.signs
        if signs is None:
            return own
        return np.concatenate([own, signs.explain(actuator, waves)], axis=1)


def joint_systems(
    parts: Sequence[Linearisation],
    noises: Sequence[NoiseModel],
    known: NormalEquations,
    deviations: Sequence[Signature],
    *,
    held_out: bool,
) -> list[JointSystem]:
    """Build the system of every experiment.

    `known` is the prior information on the free parameters: the prior of an estimate, or Cov(p̂)⁻¹
    without a gradient for held-out data, which carry no information on each other's residuals.
    `deviations` are the columns of those with tolerances, the same in all experiments.
    """
    count = len(known.gradient)
    systems = [JointSystem.of(*pair) for pair in zip(parts, noises, strict=True)]
    if held_out or len(parts) == 1:
        return [replace(each, equations=each.equations + known) for each in systems]
    shares: list[NormalEquations] = []
    for system, own in zip(systems, deviations, strict=True):
        whole = system.with_effects(own)
        order = motion_last(whole, count, own.count)
        shares.append(whole.equations.select(order).eliminate(count + own.count))
    joint = []
    for number, system in enumerate(systems):
        others = reduce(NormalEquations.__add__, shares[:number] + shares[number + 1 :])
        equations = system.equations + known + others.select(slice(count))
        joint.append(replace(system, equations=equations, others=others))
    return joint


@dataclass(frozen=True, eq=False)
class EffectProjection:
    """Whitened rows of q effects, and their part explained by the unknowns."""

    rows: Array
    """(n, q)."""
    products: Array
    """(q, u), zᵀ U."""
    mixed: Array
    """(q, r), zᵀ U root, with J⁻¹ = root rootᵀ."""
    whole: Array
    """(q,), zᵀ W z, without any unknown."""
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

    def select(self, places: Places) -> EffectProjection:
        """Return the effects at some indices."""
        own = self.products[places], self.mixed[places], self.whole[places]
        return EffectProjection(self.rows[:, places], *own, self.rest, self.freedom)

    def append(self, other: EffectProjection) -> EffectProjection:
        """Append effects of the same system, keeping computed products."""
        appended = EffectProjection(
            np.concatenate([self.rows, other.rows], axis=1),
            np.concatenate([self.products, other.products]),
            np.concatenate([self.mixed, other.mixed]),
            np.concatenate([self.whole, other.whole]),
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
        everything = ConditionalScores(self.score, self.information, self.whole, self.freedom)
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
