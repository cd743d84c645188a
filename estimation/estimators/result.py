"""Result of an estimator: parameters, covariance and its parts, and the estimate of a payload."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.estimators.covariance import (
    Covariance,
    EstimatedDeviation,
    Influence,
    SystematicUncertainty,
    difference_covariance,
    effect_difference,
    systematic_share,
)
from estimation.estimators.prior_estimate import UnloadedMachine
from estimation.estimators.priors import ParameterPriors
from estimation.measurement_model import Motion
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot.deviation import Deviation
from expdesign.runfolder import Numbers, OpenNumbers, UnboundedNumbers, described

SEEN = 0.1
"""Smallest scatter of an estimated deviation, in tolerances, at which the data say something: its
standard deviation is 0.5 % below the tolerance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimateUncertainty:
    """Covariances of an estimate, and how its iteration ended."""

    status: Annotated[str, described("", "how it ended, in words")]
    converged: Annotated[bool, described("", "the iteration ended as it should")]
    iterations: Annotated[int, described("1", "number of iterations")]
    cost: Annotated[float, described("1", "weighted sum of squares that was minimised")]
    seconds: Annotated[float, described("s", "how long it took")]
    covariance: Annotated[Numbers, described("SI", "m × m; zero for fixed parameters")]
    covariance_forces: Annotated[
        Numbers, described("SI", "its share that the forces' noise and the prior make")
    ]
    covariance_kinematics: Annotated[
        Numbers | None,
        described("SI", "its share that the lengths' noise makes; null where it is not known"),
    ]
    """None after pointwise differentiation: the covariance is then too small."""
    covariance_joint: Annotated[
        Numbers | None,
        described(
            "SI",
            "(m + e) × (m + e): random share, of the parameters and of the deviations that were "
            "estimated with them, the first e of `systematic`; null: none was",
        ),
    ] = None
    freedom: Annotated[
        UnboundedNumbers,
        described("1", "(m,) degrees of freedom of the standard deviations; null: infinite"),
    ]
    """Those of the noise's spectrum at the lines that matter for each parameter."""
    colour: Annotated[
        OpenNumbers,
        described("1", "(m,) variances over those that white noise would make"),
    ]
    systematic: Annotated[
        SystematicUncertainty | None,
        described("", "quantities with a tolerance and their effect; null: taken as exact"),
    ] = None

    @property
    def std(self) -> Array:
        """(m,), standard deviations, SI; zero for fixed parameters."""
        return np.sqrt(np.diag(self.covariance))


def uncertainty_fields(found: EstimateUncertainty) -> dict[str, Any]:
    """Return the fields that an estimate and its stored result have in common."""
    return {each.name: getattr(found, each.name) for each in fields(EstimateUncertainty)}


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterEstimate(EstimateUncertainty):
    """Estimated parameters with their covariance."""

    estimator: str
    """``"ls"``, ``"gm"`` or ``"ml"``."""
    values: Array
    """(m,), SI, in the order of the robot's parameters, including the fixed ones."""
    influences: tuple[Influence, ...]
    """Influence of every experiment's errors on the free parameters, and on θ if estimated."""
    motions: tuple[Motion, ...]
    """Motion of every experiment; estimated anew by ML. Empty for pointwise kinematics."""

    @classmethod
    def of(
        cls,
        influences: Sequence[Influence],
        priors: ParameterPriors,
        inverse: Array,
        values: Array,
        deviations: Sequence[Deviation],
        *,
        began: float,
        **ended: Any,
    ) -> ParameterEstimate:
        """Return the estimate with its covariances.

        `priors` and `inverse`, F⁻¹ of the free unknowns, (r, r), belong to the parameters and the
        deviations estimated with them, `values`, (m + e,). `ended` are further fields.
        """
        count = len(values) - len(deviations)
        found = cls(
            values=values[:count],
            **covariance_fields(influences, priors, priors.prior_share(inverse, count)),
            seconds=time.perf_counter() - began,
            **ended,
        )
        if not deviations:
            return found
        pairs = zip(deviations, values[count:].tolist(), strict=True)
        entries = [EstimatedDeviation.of(*pair) for pair in pairs]
        systematic = systematic_share(influences, entries, estimated=True)
        return replace(found.with_systematic(systematic), seconds=time.perf_counter() - began)

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

    @property
    def deviation_scatter(self) -> Array:
        """(e, e), covariance of θ̂ of machines within their tolerances.

        Up to rounding it is the tolerances' covariance less that of θ̂ − θ. Empty if no deviation
        was estimated.
        """
        estimated = len(self.joint_random) - len(self.values)
        if self.systematic is None or self.systematic.left is None or not estimated:
            return np.zeros((0, 0))
        change = (np.eye(len(self.systematic.left)) + self.systematic.left)[:estimated]
        scaled = change * self.systematic.tolerances
        return scaled @ scaled.T + self.joint_random[len(self.values) :, len(self.values) :]

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
        std = np.sqrt(np.diag(found.joint)[count:own]).tolist()
        scatter = np.sqrt(np.diag(found.deviation_scatter)).tolist()
        estimated = tuple(
            replace(one, std=own_std, scatter=spread if np.isfinite(one.tolerance) else np.nan)
            for one, own_std, spread in zip(systematic.deviations, std, scatter, strict=False)
        )
        others = systematic.deviations[len(estimated) :]
        return replace(found, systematic=replace(systematic, deviations=(*estimated, *others)))


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
        forces = forces + influence.covariance_from_forces()
        lengths = influence.covariance_from_lengths()
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
        difference = effect_difference(ml.systematic.effects, gm.systematic.effects, len(free))
        result += difference @ difference.T
    return result


TEN = tuple(OF_A_BODY)
"""Names of a payload's parameters."""
ABOUT_CENTRE = ("cx", "cy", "cz", *(f"{name}_centre" for name in TEN[4:]))
"""Names of the derived quantities: centre of mass, and inertia about it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PayloadEstimate:
    """The ten parameters of a payload: mass, sx … sz, Ixx … Iyz about the TCP, platform frame."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    covariance: Annotated[
        Numbers,
        described("SI", "10 × 10, of the new recordings and of the identification before"),
    ]
    covariance_systematic: Annotated[
        Numbers, described("SI", "its share that the robot's tolerances make, 10 × 10")
    ]
    freedom: Annotated[
        UnboundedNumbers,
        described("1", "(10,) degrees of freedom of the standard deviations; null: infinite"),
    ]

    @property
    def vector(self) -> Array:
        """(10,), the parameters, SI, in the order of `TEN`."""
        return np.array([self.values[name] for name in TEN])


def payload_estimate(estimate: ParameterEstimate, before: UnloadedMachine) -> PayloadEstimate:
    """Estimate the payload, given the machine's identification without it as prior.

    Notes
    -----
    The forces depend on p' = p + E π: the payload's ten parameters π add to those of the platform
    (a); the others (b), with constants of terms estimated with p, do not change. The identification
    gives p₀ with the covariance P; there is no prior for π. Integrated over π, the prior of p' is
    that of p_b alone, and p' is estimated with it. Then

        π̂ = p̂'_a − p̂_a = T (p̂' − p₀),   T = [1, −G],   G = P_ab P_bb⁻¹,

    since the new recording changes p_b, and with it the conditional mean of p_a. This is the
    estimate of the joint problem in (π, p) with P as the prior. The error of the identification
    e = p₀ − p enters p̂' by the gain H = F⁻¹ P_bb⁻¹ of its part b. T e is uncorrelated with that
    part, so that

        Cov(π̂) = T Cov(p̂') Tᵀ + T P Tᵀ.

    Deviations θ of the machine from its description (its tolerances) are the same in both
    recordings. Their effect on the payload, T (D' − D₀) per unit, is a difference, so that equal
    parts cancel.
    """
    transfer = before.transfer
    count = transfer.shape[1]
    own = transfer @ estimate.joint_random[:count, :count] @ transfer.T
    random = own + transfer @ before.covariance @ transfer.T
    # D' − D₀ for parameters and constants, times the tolerances.
    now = {} if estimate.systematic is None else estimate.systematic.joint_effects(count)
    then = zip(before.deviations, before.response.T, strict=True)
    before_by = {one.key: column * one.tolerance for one, column in then}
    response = effect_difference(now, before_by, count)
    systematic = transfer @ response @ response.T @ transfer.T
    total = random + systematic
    # Satterthwaite: only the variance due to the new recordings' noise is itself estimated.
    unknown = _noise_variance_uncertainty(estimate, transfer)
    with np.errstate(divide="ignore"):
        freedom = 2 * np.diag(total) ** 2 / unknown
    values = transfer @ (estimate.joint_values[:count] - before.values)
    return PayloadEstimate(
        values=dict(zip(TEN, values.tolist(), strict=True)),
        covariance=total,
        covariance_systematic=systematic,
        freedom=freedom,
    )


def _noise_variance_uncertainty(estimate: ParameterEstimate, transfer: Array) -> Array:
    """Return the variance of the estimated noise variances of T p̂', (10,).

    The noise of the combination T p̂' lies at other spectral lines than that of the parameters.
    """
    found = np.zeros(len(transfer))
    for influence in estimate.influences:
        constants = np.ones(transfer.shape[1] - len(influence.free), dtype=bool)
        combined = influence.of(transfer[:, np.concatenate([influence.free, constants])])
        lengths = combined.covariance_from_lengths()
        found += combined.covariance_from_forces().variance
        found += 0.0 if lengths is None else lengths.variance
    return found
