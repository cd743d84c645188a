"""Information of a change of parameters since an earlier identification.

The machine's parameters p are known with the covariance P, and k of them have changed by an unknown
π: a payload adds its ten parameters to those of the platform. The forces are Q = A (p + E π), with
the columns E of the k parameters. The joint information of (π, p) is

    [[Eᵀ F E, Eᵀ F], [F E, F + P⁻¹]],

and its Schur complement is the information of π with p of the prior covariance P,

    S = Eᵀ (F − F (F + P⁻¹)⁻¹ F) E = Eᵀ F (1 + P F)⁻¹ E.

With P = L Lᵀ, M = 1 + Lᵀ F L, X = M⁻¹ Lᵀ F E and R = E − L X it is S = Rᵀ F R + Xᵀ X: a sum of
squares, also where P or F is singular. Its derivatives are

    dS = Rᵀ dF R,    d²S = −2 Rᵀ dF (L M⁻¹ Lᵀ) dF R.

S is concave in F: d²S contributes a positive semidefinite curvature to a criterion that decreases
with S.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration.identification import Identification
from expdesign.information.criteria import Criterion, Curvature, SpectralCost, spectral_cost

_NOTHING = 1e-14
"""Largest eigenvalue of a correlation matrix, relative to its largest, that is a rounding error."""


@dataclass(frozen=True, eq=False)
class PriorMachine:
    """Prior covariance of all m parameters before an experiment, and the changed ones."""

    changed: NDArray[np.intp]
    """(k,), places of the changed parameters."""
    factor: Array
    """(m, r), L with P = L Lᵀ, in the units of F's parameters."""
    samples: float
    """Number of samples in the experiment's F: it weighs the data against the prior."""
    moved: Mapping[tuple[str, float], Array] = field(default_factory=dict)
    """(m,), SI, effect of one standard deviation of each tolerance on the identified values, by
    name and tolerance."""

    @classmethod
    def of(cls, known: Identification, changed: NDArray[np.intp], samples: float) -> PriorMachine:
        """Return the prior with the random part of an identification's covariance as P.

        Parameters without variance are exact. Constants estimated with the parameters are not part
        of the design and are left out.
        """
        own = slice(len(known.parameters))
        covariance = np.array(known.covariance_random)[own, own]
        response = np.array(known.response)[own]
        std = np.sqrt(np.diag(covariance))
        scale = np.where(std > 0, std, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.multiply.outer(scale, scale))
        kept = values > _NOTHING * values[-1]
        factor = std[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        moved = {
            (one.name, one.tolerance): response[:, place] * one.tolerance
            for place, one in enumerate(known.deviations)
            if one.tolerance > 0
        }
        return cls(changed, factor, samples, moved)

    def scaled(self, scaling: Array) -> PriorMachine:
        """Return the prior for an F with rows and columns multiplied by `scaling`, (m,)."""
        return replace(self, factor=self.factor / scaling[:, None])

    def information(self, information: Array, samples: float) -> Array:
        """Return S, (k, k), of F over a number of samples, (m, m).

        The prior counts in proportion to the experiment's samples.
        """
        return self._solved(information, samples).marginal

    def gain(self, information: Array, samples: float) -> Array:
        """Return S⁻¹ Rᵀ, (k, m): the response of π̂ to Aᵀ Σ⁻¹ times a change of the forces."""
        solved = self._solved(information, samples)
        return np.asarray(np.linalg.solve(solved.marginal, solved.reduced.T), dtype=np.float64)

    def cost(
        self, information: Array, samples: float, criterion: Criterion, level: float
    ) -> SpectralCost:
        """Evaluate a criterion of S, with its derivatives with respect to F, (m, m).

        The basis is (m, k + r): R times the eigenvectors of S, then L M^(−1/2).
        """
        solved = self._solved(information, samples)
        own = spectral_cost(solved.marginal, criterion, level)
        whitened = sla.solve_triangular(solved.root, solved.factor.T, lower=True).T
        count, others = len(own.slope), whitened.shape[1]

        def curvature() -> Curvature:
            diagonal, between = own.curvature()
            mixing = np.zeros((count + others,) * 2)
            mixing[:count, :count] = between
            mixing[:count, count:] = np.maximum(-own.slope, 0.0)[:, None]
            mixing[count:, :count] = mixing[:count, count:].T
            return Curvature(np.pad(diagonal, (0, others)), mixing)

        return SpectralCost(
            own.value,
            np.concatenate([solved.reduced @ own.basis, whitened], axis=1),
            np.concatenate([own.slope, np.zeros(others)]),
            curvature,
        )

    def _solved(self, information: Array, samples: float) -> _Solved:
        factor = self.factor * np.sqrt(self.samples / samples)
        seen = information @ factor
        root = np.linalg.cholesky(np.eye(factor.shape[1]) + factor.T @ seen)
        share = sla.cho_solve((root, True), seen[self.changed].T)
        reduced = -factor @ share
        reduced[self.changed, np.arange(len(self.changed))] += 1.0
        marginal = reduced.T @ information @ reduced + share.T @ share
        return _Solved((marginal + marginal.T) / 2, factor, root, reduced)


class _Solved(NamedTuple):
    marginal: Array
    """(k, k), S."""
    factor: Array
    """(m, r), L in proportion to the samples."""
    root: Array
    """(r, r), lower triangular root of M."""
    reduced: Array
    """(m, k), R."""
