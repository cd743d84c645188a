"""Information on some unknowns while others are unknown too, with or without a prior.

The forces depend on the unknowns u, M of them, with the information F. Wanted are π, and the others
are z: u = E π + G z, with a standard normal prior of some z and no prior of the rest. With J the
diagonal matrix of ones (prior) and zeros (none), the information on π is the Schur complement

    S = Rᵀ F R + Kᵀ J K,   M = J + Gᵀ F G,   K = M⁻¹ Gᵀ F E,   R = E − G K,

with dS = Rᵀ dF R and d²S = −2 Rᵀ dF G M⁻¹ Gᵀ dF R. The columns of E and G make it serve every case:

- some parameters are of interest, the others are nuisances (D_s-optimality): unit columns;
- tolerances that the estimator estimates: columns of one standard deviation;
- the change π of a machine with the prior covariance P = L Lᵀ: unit columns and L.

The information P of earlier recordings adds to F in all of this.

An estimator may also leave further effects G_b z_b in the residuals, and only state the errors that
they cause (a budget). With T = Rᵀ F G_b the covariance of π̂ is then

    C = S⁻¹ + S⁻¹ T Tᵀ S⁻¹,

and C⁻¹ takes the place of S. With X = R S⁻¹, Y = G_b − G M⁻¹ Gᵀ F G_b − X T and V = Y Tᵀ S⁻¹

    −dC = (X − V)ᵀ dF (X − V) − Vᵀ dF V.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration.tolerances import Identification
from expdesign.information.criteria import Criterion, Curvature, SpectralCost, spectral_cost

_NOTHING = 1e-14
"""Largest eigenvalue of a correlation matrix, relative to its largest, that is a rounding error."""


@dataclass(frozen=True, eq=False)
class Marginal:
    """Unknowns of interest and nuisances of an experiment."""

    interest: Array
    """(M, k), E: effect of each quantity of interest on the unknowns."""
    nuisance: Array
    """(M, r), G: effect of each nuisance; with a prior, of one standard deviation."""
    known: Array
    """(r,), one for a nuisance with a prior, zero without."""
    samples: float
    """Number of samples in the experiment's F: it weighs the data against the priors."""
    budget: Array | None = None
    """(M, b), G_b: effects of one standard deviation that are not estimated; None: none."""
    earlier: Array | None = None
    """(M, M), P, information of other recordings of the machine on the unknowns; None: none."""
    moved: Mapping[tuple[str, float], Array] = field(default_factory=dict)
    """(m,), SI, effect of one standard deviation of each tolerance on the values identified before,
    by name and tolerance."""

    @classmethod
    def of_change(
        cls, known: Identification, changed: NDArray[np.intp], samples: float
    ) -> Marginal:
        """Return the change of some parameters since an identification.

        The prior is the random part of its covariance. Parameters without variance are exact.
        Constants estimated with the parameters are not part of the design and are left out.

        Parameters
        ----------
        changed : (k,)
            Places of the changed parameters.
        samples : float
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
        ones = np.ones(factor.shape[1])
        return cls(np.eye(len(std))[:, changed], factor, ones, samples, moved=moved)

    @classmethod
    def of_all(cls, count: int, samples: float) -> Marginal:
        """Return all unknowns as interest."""
        return cls(np.eye(count), np.zeros((count, 0)), np.zeros(0), samples)

    @classmethod
    def of_quantities(cls, slopes: Array, scales: Array, samples: float) -> Marginal:
        """Return linear functions of the unknowns as interest, all the rest without a prior.

        Parameters
        ----------
        slopes : (k, M)
            Derivatives of the quantities to the unknowns, of full rank.
        scales : (M,)
            Sizes of the unknowns, for accuracy.
        samples : float

        Examples
        --------
        >>> import numpy as np
        >>> second = Marginal.of_quantities(np.array([[0.0, 1.0]]), np.ones(2), 1.0)
        >>> second.information(np.array([[1.0, 0.5], [0.5, 1.0]]), 1.0).tolist()
        [[0.75]]
        """
        scaled = slopes * scales
        others = sla.null_space(scaled)
        inverse = np.linalg.pinv(scaled)
        free = np.zeros(others.shape[1])
        return cls(scales[:, None] * inverse, scales[:, None] * others, free, samples)

    def with_effects(
        self, effects: Array, keys: Sequence[tuple[str, float]], *, estimated: bool
    ) -> Marginal:
        """Return the same interest with further unknowns that have priors.

        Causes in `moved` have affected an earlier identification by the same deviations.

        Parameters
        ----------
        effects : (t, n)
            Effect of one standard deviation of each cause on the t further unknowns.
        keys : n names with tolerances
            Of the causes.
        estimated : bool
            False: their errors are stated in a budget.
        """
        further, known = len(effects), len(self.interest)
        before = {key: value for key, value in self.moved.items() if key not in keys}
        own = [self.moved.get(key, np.zeros(known)) for key in keys]
        count = len(keys) + len(before)
        causes = np.zeros((known + further, count))
        causes[:known] = -np.array([*own, *before.values()]).reshape(count, known).T
        causes[known:, : len(keys)] = effects
        extend = ((0, further), (0, 0))
        longer = replace(
            self, interest=np.pad(self.interest, extend), nuisance=np.pad(self.nuisance, extend)
        )
        if not estimated:
            return replace(longer, budget=causes)
        return replace(
            longer,
            nuisance=np.concatenate([longer.nuisance, causes], axis=1),
            known=np.append(self.known, np.ones(count)),
        )

    def scaled(self, scaling: Array, judged: Array) -> Marginal:
        """Return it for an F with rows and columns multiplied by `scaling`, (M,).

        The quantities of interest are in multiples of `judged`, (k,).
        """
        rows = scaling[:, None]
        budget = None if self.budget is None else self.budget / rows
        earlier = None if self.earlier is None else self.earlier * np.outer(scaling, scaling)
        return replace(
            self,
            interest=self.interest * judged / rows,
            nuisance=self.nuisance / rows,
            budget=budget,
            earlier=earlier,
        )

    def information(self, information: Array, samples: float) -> Array:
        """Return the information on the interest, (k, k), of F over a number of samples, (M, M).

        Priors and earlier recordings count in proportion to the experiment's samples.
        """
        solved = self._solve(information, samples)
        return solved.marginal if solved.budget is None else solved.budget.information

    def gain(self, information: Array, samples: float) -> Array:
        """Return S⁻¹ Rᵀ, (k, M): the response of π̂ to Aᵀ Σ⁻¹ times a change of the forces."""
        solved = self._solve(information, samples)
        return np.asarray(np.linalg.solve(solved.marginal, solved.reduced.T), dtype=np.float64)

    def cost(
        self, information: Array, samples: float, criterion: Criterion, level: float
    ) -> SpectralCost:
        """Evaluate a criterion of the information on the interest, with derivatives to F, (M, M).

        The basis is (M, k + r): R times the eigenvectors of S, then G M^(−1/2). With a budget it is
        (M, 2 k), and its second half counts negative.
        """
        solved = self._solve(information, samples)
        if solved.budget is not None:
            own = spectral_cost(solved.budget.information, criterion, level)
            turned = solved.budget.information @ own.basis
            halves = [solved.budget.gained @ turned, solved.budget.lost @ turned]
            slope = np.concatenate([own.slope, -own.slope])
            return replace(own, basis=np.concatenate(halves, axis=1), slope=slope, subtracted=True)
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

    def _solve(self, information: Array, samples: float) -> _Solved:
        weight = np.sqrt(self.samples / samples)
        if self.earlier is not None:
            information = information + self.earlier / weight**2
        factor = self.nuisance * weight
        seen = information @ factor
        gram = factor.T @ seen
        # A nuisance without a prior that nothing excites leaves no trace: M stays regular.
        least = np.where(self.known > 0, self.known, _NOTHING * np.diag(gram) + _TINY)
        root = np.linalg.cholesky(np.diag(least) + gram)
        share = sla.cho_solve((root, True), seen.T @ self.interest)
        reduced = self.interest - factor @ share
        prior = np.sqrt(self.known)[:, None] * share
        marginal = reduced.T @ information @ reduced + prior.T @ prior
        marginal = (marginal + marginal.T) / 2
        solved = _Solved(marginal, factor, root, reduced)
        if self.budget is None:
            return solved
        effect = self.budget * weight
        left = effect - factor @ sla.cho_solve((root, True), seen.T @ effect)
        response = reduced.T @ information @ effect
        # The inverse of C by Woodbury's identity.
        inverse = np.linalg.inv(marginal)
        biased = inverse @ response
        middle = np.eye(effect.shape[1]) + response.T @ biased
        total = marginal - response @ np.linalg.solve(middle, response.T)
        moved = (left - reduced @ biased) @ biased.T
        return solved._replace(
            budget=_Budget((total + total.T) / 2, reduced @ inverse - moved, moved)
        )


_TINY = np.finfo(float).tiny


def earlier_information(
    known: Identification, names: Sequence[str], deviations: Sequence[str]
) -> Array:
    """Return the information of an earlier estimate on parameters and deviations, (k + t, k + t).

    In SI, that of the recordings alone, without the tolerances as priors. With the covariances C
    of the errors of parameters p and deviations θ, the latter in units of their tolerances,

        F_pp = (C_pp − C_pθ C_θθ⁻¹ C_θp)⁻¹,   W = −C_pθ C_θθ⁻¹,
        F_pθ = F_pp W,   F_θθ = Wᵀ F_pp W + C_θθ⁻¹ − 1.

    Parameters and deviations of the estimate that are not named count as known.

    Parameters
    ----------
    known : Identification
        Of an estimate that contains all the names.
    names : k names
        Of parameters.
    deviations : t names
    """
    count = len(known.parameters)
    own = dict[str, int]()
    for place, one in enumerate(known.deviations):
        if one.tolerance > 0:
            own.setdefault(one.name, place)  # a later entry of the name is a prior's error
    places = np.array([*own.values()], dtype=np.intp)
    every = np.array([one.tolerance for one in known.deviations])
    stated = every[places]
    size = len(known.covariance_random), len(every)
    response = np.array(known.response).reshape(size)[:count] * every
    random = np.array(known.covariance_random)[:count, :count]
    mixed, others = -response[:, places], np.eye(len(places))
    if known.covariance_deviations:
        joint = np.array(known.covariance_deviations)[:, places] / stated
        mixed, others = joint[:count], joint[count + places] / stated[:, None]
    std = np.sqrt(np.diag(random))
    estimated = np.flatnonzero(std > 0)
    scale = np.append(std[estimated], stated)
    solved = np.linalg.solve(others, mixed.T).T
    apart = (random + response @ response.T - solved @ mixed.T)[np.ix_(estimated, estimated)]
    alone = np.linalg.inv(apart / np.multiply.outer(std[estimated], std[estimated]))
    effect = np.hstack([np.eye(len(estimated)), -solved[estimated] / std[estimated, None]])
    seen, modes = np.linalg.eigh(others)
    learnt = (modes * np.maximum(1 / seen - 1, 0.0)) @ modes.T
    found = effect.T @ alone @ effect
    found[len(estimated) :, len(estimated) :] += learnt
    listed = [*(known.parameters[k] for k in estimated), *own]
    found /= np.multiply.outer(scale, scale)
    at = [listed.index(name) for name in (*names, *deviations)]
    return (found + found.T)[np.ix_(at, at)] / 2


class _Budget(NamedTuple):
    information: Array
    """(k, k), C⁻¹."""
    gained: Array
    """(M, k), X − V."""
    lost: Array
    """(M, k), V."""


class _Solved(NamedTuple):
    marginal: Array
    """(k, k), S."""
    factor: Array
    """(M, r), G in proportion to the samples."""
    root: Array
    """(r, r), lower triangular root of M."""
    reduced: Array
    """(M, k), R."""
    budget: _Budget | None = None
