"""What data say of effects beyond what the unknowns explain, and of some beyond others.

With the rows z of the effects, s = zᵀ e* and I = zᵀ z − zᵀ U J⁻¹ Uᵀ z (all whitened) hold
everything: the effects C beside the effects S have

    s_C − I_CS I_SS⁻¹ s_S,   I_CC − I_CS I_SS⁻¹ I_SC,

so that every subset is fitted, and compared with every other, without going back to the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array

SEEN = 1e-6
"""Share of an effect's information that the unknowns, and the effects beside it, must leave."""

Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Projection:
    """Whitened rows of q effects, and their part that the unknowns explain."""

    rows: Array
    """(n, q)."""
    mixed: Array
    """(q, r), zᵀ U root, with J⁻¹ = root rootᵀ."""
    rest: Array
    """(n,), whitened e*."""
    freedom: float
    """Degrees of freedom behind Σ; inf when it was given."""

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

    def joined(self, other: Projection) -> Projection:
        """Append effects of the same system; what was computed of these is kept."""
        joined = Projection(
            np.concatenate([self.rows, other.rows], axis=1),
            np.concatenate([self.mixed, other.mixed]),
            self.rest,
            self.freedom,
        )
        cross = self.rows.T @ other.rows
        # The cached properties are filled with what is known already.
        joined.__dict__["gram"] = np.block([[self.gram, cross], [cross.T, other.gram]])
        joined.__dict__["score"] = np.concatenate([self.score, other.score])
        return joined

    def beside(self, known: Sequence[int] | Places) -> Conditional:
        """Return the effects beside those at some places, which are fitted with them."""
        everything = Conditional(self.score, self.information, np.diag(self.gram), self.freedom)
        return everything.beside(known)


@dataclass(frozen=True, eq=False)
class Conditional:
    """Scores and information of q effects beside some others."""

    score: Array
    information: Array
    """(q,) and (q, q)."""
    whole: Array
    """(q,), zᵀ z."""
    freedom: float

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(q,) effects of which, one by one, something is left to be seen."""
        return np.diag(self.information) > SEEN * np.where(self.whole > 0, self.whole, np.inf)

    def beside(self, known: Sequence[int] | Places) -> Conditional:
        """Return the effects beside those at some places, too, which are fitted with them."""
        places = np.asarray(known, dtype=np.intp)
        if not len(places):
            return self
        root, _ = _root(self.information[np.ix_(places, places)], self.whole[places])
        explained = self.information[:, places] @ root
        return Conditional(
            self.score - explained @ (root.T @ self.score[places]),
            self.information - explained @ explained.T,
            self.whole,
            self.freedom,
        )

    def fit(self, places: Sequence[int] | Places) -> Fit:
        """Fit the effects at some places together."""
        chosen = np.asarray(places, dtype=np.intp)
        root, rank = _root(self.information[np.ix_(chosen, chosen)], self.whole[chosen])
        part = root.T @ self.score[chosen]
        return Fit(float(part @ part), rank, root @ part, root @ root.T)


@dataclass(frozen=True, eq=False)
class Fit:
    """Some effects fitted together."""

    statistic: float
    """χ² of no such effects, or ν-fold of it with an estimated Σ."""
    rank: int
    """Its degrees of freedom: combinations of which something is seen."""
    values: Array
    covariance: Array
    """(k,) and (k, k), in the units of the effects."""


def _root(information: Array, whole: Array) -> tuple[Array, int]:
    """Return R with R Rᵀ = I⁺, of those combinations of which something is seen; their number."""
    scales = np.sqrt(np.where(whole > 0, whole, 1.0))
    values, vectors = np.linalg.eigh(information / np.multiply.outer(scales, scales))
    kept = values > SEEN
    return vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None], int(np.count_nonzero(kept))
