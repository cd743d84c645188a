"""Estimate of a payload on a machine that was identified without it.

The forces depend on p' = p + E π: the payload's ten parameters π add to those of the platform (a);
the others (b) do not change. The identification gives p₀ with the covariance P; there is no prior
for π. Integrated over π, the prior of p' is that of p_b alone, and p' is estimated with it. Then

    π̂ = p̂'_a − p̂_a = T (p̂' − p₀),   T = [1, −G],   G = P_ab P_bb⁻¹,

since the new recording changes p_b, and with it the conditional mean of p_a. This is the estimate
of the joint problem in (π, p) with P as the prior. The error of the identification e = p₀ − p
enters p̂' by the gain H = F⁻¹ P_bb⁻¹ of its part b. T e is uncorrelated with that part, so that

    Cov(π̂) = T Cov(p̂') Tᵀ + T P Tᵀ.

Deviations θ of the machine from its description (its tolerances) are the same in both recordings.
Their effect on the payload, T (D' − D₀) per unit, is a difference, so that equal parts cancel.

Constants of terms that were estimated with p belong to the others (b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.estimators.prior_estimate import PriorEstimate
from estimation.estimators.result import ParameterEstimate
from expdesign.mechanism.bodies import ENTRIES, RigidBody, inertia_of
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY

TEN = tuple(OF_A_BODY)
"""Names of a payload's parameters."""
ABOUT_CENTRE = ("cx", "cy", "cz", *(f"{name}_centre" for name in TEN[4:]))
"""Names of the derived quantities: centre of mass, and inertia about it."""


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """Ten parameters of a payload with their covariance, SI, in the order of `TEN`."""

    values: Array
    """(10,)."""
    covariance: Array
    """(10, 10), total covariance: of the new recordings and of the identification before."""
    covariance_systematic: Array
    """(10, 10), its part due to the tolerances."""
    freedom: Array
    """(10,), degrees of freedom of the standard deviations."""


def payload_estimate(estimate: ParameterEstimate, before: PriorEstimate) -> PayloadEstimate:
    """Estimate the payload, given the machine's identification without it as prior.

    Raises
    ------
    ValueError
        The prior is that of a machine without a payload.
    """
    if before.unloaded is None:
        raise ValueError("the prior belongs to the machine with its payload")
    transfer = before.unloaded.transfer
    count = transfer.shape[1]
    own = transfer @ estimate.joint_random[:count, :count] @ transfer.T
    random = own + transfer @ before.unloaded.covariance @ transfer.T
    response = _shared_response(estimate, before)
    systematic = transfer @ response @ response.T @ transfer.T
    total = random + systematic
    # Satterthwaite: only the variance due to the new recordings' noise is itself estimated.
    unknown = _noise_variance_uncertainty(estimate, transfer)
    with np.errstate(divide="ignore"):
        freedom = 2 * np.diag(total) ** 2 / unknown
    values = transfer @ (estimate.joint_values[:count] - before.unloaded.values)
    return PayloadEstimate(values, total, systematic, freedom)


def _noise_variance_uncertainty(estimate: ParameterEstimate, transfer: Array) -> Array:
    """Return the variance of the estimated noise variances of T p̂', (10,).

    The noise of the combination T p̂' lies at other spectral lines than that of the parameters.
    """
    found = np.zeros(len(transfer))
    for influence in estimate.influences:
        constants = np.ones(transfer.shape[1] - len(influence.free), dtype=bool)
        combined = influence.of(transfer[:, np.concatenate([influence.free, constants])])
        lengths = combined.length_share()
        found += combined.force_share().variance
        found += 0.0 if lengths is None else lengths.variance
    return found


def _shared_response(estimate: ParameterEstimate, before: PriorEstimate) -> Array:
    """Return D' − D₀, (m + c, t), times the tolerances; entries of equal tolerance are matched."""
    count = len(before.values)
    found = {}
    if (own := estimate.systematic) is not None:
        scaled = (
            own.scaled_response
            if count == len(estimate.values)
            else own.joint_scaled_response[:count]
        )
        keys = ((one.name, one.std) for one in own.deviations)
        found = dict(zip(keys, scaled.T, strict=True))
    for one, column in zip(before.deviations, before.response.T, strict=True):
        key = one.name, one.std
        found[key] = found.get(key, np.zeros(count)) - column * one.std
    return np.array(list(found.values())).reshape(-1, count).T


def about_centre(values: Array) -> tuple[Array, Array]:
    """Return the centre of mass and the inertia about it, of a payload's ten parameters.

    Returns
    -------
    derived : (9,)
        In the order of `ABOUT_CENTRE`.
    slope : (9, 10)
        Its derivatives with respect to the ten, for the delta method.
    """
    mass, moment = float(values[0]), values[1:4]
    centre = moment / mass
    inertia = RigidBody(1.0, centre, inertia_of(values[4:] / mass)).about_centre * mass
    slope = np.zeros((len(ABOUT_CENTRE), len(TEN)))
    slope[:3, 0] = -centre / mass
    slope[:3, 1:4] = np.eye(3) / mass
    by_moment = [
        -(2 * centre[k] * np.eye(3) - np.outer(axis, centre) - np.outer(centre, axis))
        for k, axis in enumerate(np.eye(3))
    ]
    by_mass = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    for row, (i, j) in enumerate(ENTRIES, start=3):
        slope[row, 0] = by_mass[i, j]
        slope[row, 1:4] = [each[i, j] for each in by_moment]
    slope[3:, 4:] = np.eye(6)
    derived = np.concatenate([centre, [inertia[i, j] for i, j in ENTRIES]])
    return derived, slope
