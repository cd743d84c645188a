"""Result of an estimator: parameters, covariance and its parts."""

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
    """Estimated parameters with their covariance."""

    estimator: str
    """``"ls"``, ``"gm"`` or ``"ml"``."""
    values: Array
    """(m,), SI, in the order of the robot's parameters, including the fixed ones."""
    covariance: Array
    """(m, m), total covariance; zero for fixed parameters."""
    systematic: SystematicUncertainty | None = None
    """Systematic part, due to tolerances; None if everything counts as exact."""
    covariance_forces: Array
    """(m, m), part due to the noise of the forces (and the prior)."""
    covariance_kinematics: Array | None
    """(m, m), part due to the noise of the lengths; None if it is unknown (pointwise
    differentiation): the covariance is then too small."""
    freedom: Array
    """(m,), degrees of freedom of the standard deviations: those of the noise's spectrum at the
    lines that matter for each parameter; inf if the noise is taken as known."""
    colour: Array
    """(m,), ratio of the variance to that under white noise of the same covariance."""
    influences: tuple[Influence, ...]
    """Influence of every experiment's errors on the free parameters, and on θ if estimated."""
    motions: tuple[HarmonicMotion, ...]
    """Motion of every experiment; estimated anew by ML. Empty for pointwise kinematics."""
    cost: float
    """Weighted sum of squares at the minimum."""
    iterations: int
    converged: bool
    status: str
    seconds: float
    equations: tuple[NormalEquations, ...] = ()
    """Normal equations of (p, ξ) from the forces of every experiment, kept by LS and GM for fitted
    motions without estimated constants; otherwise empty."""
    covariance_joint: Array | None = None
    """(m + e, m + e), random part for the parameters and the e entries of θ estimated with them,
    the first of `systematic`; None: there are none."""

    def largest_colour_ratio(self) -> tuple[int, float, float]:
        """Return the parameter whose variance coloured noise raises most, the ratio and its p.

        Only the random part depends on the noise's colour, so that its degrees of freedom count.
        """
        k = int(np.argmax(self.colour))
        random = float(self.covariance_random[k, k])
        grown = float(self.covariance[k, k]) / random if random > 0 else 1.0
        ratio, freedom = float(self.colour[k]), float(self.freedom[k]) / grown**2
        p = float(scipy.stats.chi2.sf(ratio * freedom, freedom)) if np.isfinite(freedom) else 1.0
        return k, ratio, min(1.0, len(self.values) * p)

    @property
    def std(self) -> Array:
        """(m,), standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def covariance_systematic(self) -> Array:
        """(m, m), systematic part, due to tolerances; zero if everything is exact."""
        if self.systematic is None:
            return np.zeros_like(self.covariance)
        return self.systematic.covariance

    @property
    def covariance_random(self) -> Array:
        """(m, m), random part: independent in another recording of the same machine."""
        if self.covariance_joint is None:
            return self.covariance - self.covariance_systematic
        return self.covariance_joint[: len(self.values), : len(self.values)]

    @property
    def joint_random(self) -> Array:
        """(m + e, m + e), random part, including the deviations estimated with the parameters."""
        return self.covariance_random if self.covariance_joint is None else self.covariance_joint

    @property
    def joint_values(self) -> Array:
        """(m + t,), the parameters, followed by θ."""
        theta = np.zeros(0) if self.systematic is None else self.systematic.values
        return np.concatenate([self.values, theta])

    @property
    def joint(self) -> Array:
        """(m + t, m + t), total covariance of the errors of (p̂, θ̂)."""
        if self.systematic is None:
            return self.covariance
        scaled, random = self.systematic.joint_scaled_response, self.joint_random
        return np.pad(random, (0, len(scaled) - len(random))) + scaled @ scaled.T

    def with_systematic(self, systematic: SystematicUncertainty | None) -> ParameterEstimate:
        """Return the estimate with the systematic part of its covariance.

        The systematic part counts as known: the degrees of freedom grow with it.
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


def covariance_fields(
    influences: Sequence[Influence], priors: ParameterPriors, prior_share: Array
) -> dict[str, Any]:
    """Return the covariances of `ParameterEstimate`, their freedom and colour.

    `priors` belong to the parameters and the deviations estimated with them; `prior_share`, (r, r),
    is the covariance due to the priors' errors.
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
    count, joint = len(influences[0].free), priors.expand(total.matrix)
    own = slice(count), slice(count)
    return {
        "covariance": joint[own],
        "covariance_joint": joint if len(joint) > count else None,
        "covariance_forces": priors.expand(forces.matrix)[own],
        "covariance_kinematics": None
        if kinematics is None
        else priors.expand(kinematics.matrix)[own],
        "freedom": known[:count],
        "colour": ratio[:count],
        "influences": tuple(influences),
    }


def covariance_ml_less_gm(estimates: Mapping[str, ParameterEstimate]) -> Array | None:
    """Return the covariance of ML − GM from the same data, (m, m); None without both.

    It includes the difference of their systematic errors.
    """
    if not {"gm", "ml"} <= set(estimates):
        return None
    gm, ml = estimates["gm"], estimates["ml"]
    result, free = np.zeros_like(ml.covariance), ml.influences[0].free
    result[np.ix_(free, free)] = difference_covariance(ml.influences, gm.influences)
    if gm.systematic is not None and ml.systematic is not None:
        if gm.systematic.deviations != ml.systematic.deviations:
            raise ValueError("both estimates have the tolerances of the same machine")
        difference = ml.systematic.scaled_response - gm.systematic.scaled_response
        result += difference @ difference.T
    return result
