"""The result of an estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.estimators.influence import (
    Covariance,
    Influence,
    SystematicUncertainty,
    difference_covariance,
)
from estimation.estimators.priors import ParameterPriors
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.normal_equations import NormalEquations


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterEstimate:
    """Parameters with their covariance."""

    estimator: str
    """``"ls"``, ``"gm"`` or ``"ml"``."""
    values: Array
    """(m,), SI, in the order of the robot's parameters; fixed ones included."""
    covariance: Array
    """(m, m), of the estimate, all shares together; zero for fixed parameters."""
    systematic: SystematicUncertainty | None = None
    """The share of what is not known exactly; None where everything is taken as exact."""
    covariance_forces: Array
    """(m, m), the part that the noise of the forces (and the prior) makes."""
    covariance_kinematics: Array | None
    """(m, m), the part that the noise of the lengths makes; None where it is not known (pointwise
    differentiation): the covariance is then too small."""
    freedom: Array
    """(m,), degrees of freedom behind the standard deviations: of the noise's spectrum at the lines
    that matter for each parameter; inf where the noise is taken as known."""
    colour: Array
    """(m,), variance over the one that white noise of the same covariance would make."""
    influences: tuple[Influence, ...]
    """How the errors of every experiment move the free parameters, and θ where it is estimated."""
    motions: tuple[HarmonicMotion, ...]
    """The motion of every experiment; estimated anew by ML. Empty for pointwise kinematics."""
    cost: float
    """Weighted sum of squares that was minimised."""
    iterations: int
    converged: bool
    status: str
    seconds: float
    equations: tuple[NormalEquations, ...] = ()
    """What the forces of every experiment say of (p, ξ) where LS and GM found them along fitted
    motions, constants of terms as described; empty elsewhere."""
    covariance_joint: Array | None = None
    """(m + e, m + e), random share, of the parameters and of the e entries of θ that were estimated
    with them, the first of `systematic`; None: none was."""

    def largest_colour_ratio(self) -> tuple[int, float, float]:
        """Return the parameter whose variance colour raises most, its ratio, and its p.

        Colour is of the random share alone: what is known of the rest makes it no better known.
        """
        k = int(np.argmax(self.colour))
        random = float(self.covariance_random[k, k])
        grown = float(self.covariance[k, k]) / random if random > 0 else 1.0
        ratio, freedom = float(self.colour[k]), float(self.freedom[k]) / grown**2
        p = float(scipy.stats.chi2.sf(ratio * freedom, freedom)) if np.isfinite(freedom) else 1.0
        return k, ratio, min(1.0, len(self.values) * p)

    @property
    def std(self) -> Array:
        """(m,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def covariance_systematic(self) -> Array:
        """(m, m), the part that what is not known exactly makes: zero where all is exact."""
        if self.systematic is None:
            return np.zeros_like(self.covariance)
        return self.systematic.covariance

    @property
    def covariance_random(self) -> Array:
        """(m, m), the part that another recording of the same machine draws anew."""
        if self.covariance_joint is None:
            return self.covariance - self.covariance_systematic
        return self.covariance_joint[: len(self.values), : len(self.values)]

    @property
    def joint_random(self) -> Array:
        """(m + e, m + e), the same with what was estimated together with the parameters."""
        return self.covariance_random if self.covariance_joint is None else self.covariance_joint

    @property
    def joint_values(self) -> Array:
        """(m + t,), the parameters and θ behind them."""
        theta = np.zeros(0) if self.systematic is None else self.systematic.values
        return np.concatenate([self.values, theta])

    @property
    def joint(self) -> Array:
        """(m + t, m + t), covariance of the errors of (p̂, θ̂), all shares together."""
        if self.systematic is None:
            return self.covariance
        scaled, random = self.systematic.joint_scaled, self.joint_random
        return np.pad(random, (0, len(scaled) - len(random))) + scaled @ scaled.T

    def with_systematic(self, systematic: SystematicUncertainty | None) -> ParameterEstimate:
        """Return the estimate with the share of what is not known exactly.

        That share is taken as known: what is behind the standard deviations grows with it.
        """
        if systematic is None:
            return self
        total = self.covariance_random + systematic.covariance
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = np.diag(total) / np.diag(self.covariance)
        freedom = self.freedom * np.nan_to_num(grown, nan=1.0, posinf=np.inf) ** 2
        found = replace(self, covariance=total, freedom=freedom, systematic=systematic)
        count, own = len(self.values), len(self.joint_random)
        if own == count:
            return found
        estimated = np.sqrt(np.diag(found.joint)[count:own])
        std = np.concatenate([estimated, systematic.std[own - count :]])
        return replace(found, systematic=replace(systematic, std=std))


def precision(
    influences: Sequence[Influence], priors: ParameterPriors, prior_share: Array
) -> dict[str, Any]:
    """Return the covariances of `ParameterEstimate`, their freedom and colour.

    `priors` is of the parameters and of what is estimated with them, and `prior_share`, (r, r),
    what the error of the priors makes of these.
    """
    forces = Covariance.known(prior_share)
    kinematics: Covariance | None = Covariance.known(np.zeros_like(prior_share))
    for influence in influences:
        forces = forces + influence.force_share()
        lengths = influence.length_share()
        kinematics = None if kinematics is None or lengths is None else kinematics + lengths
    total = forces if kinematics is None else forces + kinematics
    variance = np.diag(total.matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Satterthwaite's degrees of freedom of a sum of independent mean squares.
        freedom = np.where(total.variance > 0, 2 * variance**2 / total.variance, np.inf)
        colour = variance / np.diag(total.white)
    known = np.full(len(priors.free), np.inf)
    known[priors.free] = freedom
    ratio = np.ones(len(priors.free))
    ratio[priors.free] = colour
    count, joint = len(influences[0].free), priors.full(total.matrix)
    own = slice(count), slice(count)
    return {
        "covariance": joint[own],
        "covariance_joint": joint if len(joint) > count else None,
        "covariance_forces": priors.full(forces.matrix)[own],
        "covariance_kinematics": None
        if kinematics is None
        else priors.full(kinematics.matrix)[own],
        "freedom": known[:count],
        "colour": ratio[:count],
        "influences": tuple(influences),
    }


def covariance_ml_less_gm(estimates: Mapping[str, ParameterEstimate]) -> Array | None:
    """Return the covariance of ML − GM from the same data, (m, m); None without both.

    What is not known exactly moves both, each in its own way.
    """
    if not {"gm", "ml"} <= set(estimates):
        return None
    gm, ml = estimates["gm"], estimates["ml"]
    result, free = np.zeros_like(ml.covariance), ml.influences[0].free
    result[np.ix_(free, free)] = difference_covariance(ml.influences, gm.influences)
    if gm.systematic is not None and ml.systematic is not None:
        if gm.systematic.deviations != ml.systematic.deviations:
            raise ValueError("both estimates have the tolerances of the same machine")
        apart = ml.systematic.scaled - gm.systematic.scaled
        result += apart @ apart.T
    return result
