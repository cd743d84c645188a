"""Criteria of optimality (D, A, E, condition number) as functions of the eigenvalues of F."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import scipy

from constraints.arrays import Array
from constraints.plugins import declarations


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """A criterion of optimality: its reported value, and a cost that an optimiser minimises."""

    key: str
    """Value of ``design.criterion`` in the YAML."""
    title: str
    larger_is_better: bool
    invariant: bool = False
    """Whether a rescaling of the parameters only shifts the cost."""
    flat: bool = False
    """Whether the cost hardly changes where a parameter is hardly excited: the search then begins
    with log det F."""
    levels: tuple[float, ...]
    """Sharpness of a smooth surrogate, continued from blunt to sharp; (0.0,) if it is exact."""
    value: Callable[[Array], float]
    """Eigenvalues of the scaled F → the reported number."""
    cost: Callable[[Array, float], tuple[float, Array, Array]]
    """(logarithms of the eigenvalues (m,), ascending; level) → a smooth cost of order one, with its
    gradient (m,) and Hessian (m, m)."""
    from_cost: Callable[[float, int, int, float], float]
    """(cost of the mean of F over the samples, number m of parameters, number of samples in F, sum
    of the logarithms of the parameters' scales) → the corresponding reported number, for progress
    only."""

    def named(self, information: str) -> str:
        """Return the title with the symbol of the information matrix, ``F`` or ``S``."""
        return re.sub(r"\bF(?![a-z])", information, self.title)


@dataclass(frozen=True)
class SpectralCost:
    """A criterion's cost with its derivatives with respect to the scaled F."""

    value: float
    basis: Array
    """(m, m), eigenvectors of F, columns."""
    slope: Array
    """(m,), derivatives with respect to the eigenvalues: dcost = Σ slope_i (Vᵀ dF V)_ii."""
    curvature: Callable[[], Curvature]
    """Second derivatives, computed on demand."""
    subtracted: bool = False
    """Whether the basis has a second half, (m, 2 m), with the opposite slopes: entries of Vᵀ dF V
    are then those of the first half minus those of the second."""


class Curvature(NamedTuple):
    """Second derivatives along dF without their negative parts, with E = Vᵀ dF V."""

    diagonal: Array
    """(m, m), positive semidefinite, between the diagonal entries of E."""
    mixing: Array
    """(m, m), nonnegative, of its off-diagonal entries (Daleckii–Krein); zero diagonal."""


def spectral_cost(information: Array, criterion: Criterion, level: float) -> SpectralCost:
    """Evaluate a criterion on the scaled F, (m, m), for a Gauss–Newton method."""
    values, basis = np.linalg.eigh(information)
    # Rounding errors may make eigenvalues of a nearly singular F negative: they are clipped.
    values = np.maximum(values, np.finfo(float).eps ** 2 * values[-1])
    cost, gradient, hessian = criterion.cost(np.log(values), level)
    slope = gradient / values
    return SpectralCost(cost, basis, slope, partial(_curvature, values, gradient, hessian))


def _curvature(values: Array, gradient: Array, hessian: Array) -> Curvature:
    """Return the curvature of φ(log λ(F)), with the derivatives of φ.

    The second derivative along dF is
    Σ φ''_ij E_ii E_jj + Σ_{i≠j} (φ'_i − φ'_j)/(λ_i − λ_j) E_ij²; its negative parts are removed.
    """
    slope = gradient / values
    curvature = (hessian - np.diag(gradient)) / np.multiply.outer(values, values)
    gap = np.subtract.outer(values, values)
    close = np.abs(gap) <= 1e-9 * np.maximum.outer(values, values)
    with np.errstate(divide="ignore", invalid="ignore"):
        mixing = np.where(close, 0.0, np.subtract.outer(slope, slope) / gap)
    # The limit of the difference quotient for coinciding eigenvalues.
    second = np.diag(curvature)[:, None] - curvature
    mixing = np.where(close, (second + second.T) / 2, mixing)
    np.fill_diagonal(mixing, 0.0)
    spectrum, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    diagonal = (vectors * np.maximum(spectrum, 0.0)) @ vectors.T
    return Curvature(diagonal, np.maximum(mixing, 0.0))


def log_sum_exp(logs: Array, power: float) -> tuple[float, Array, Array]:
    """Return log(Σ exp(p x))/|p| with gradient and Hessian with respect to x, (m,).

    For p → +∞ it tends to the largest x, for p → −∞ to minus the smallest.

    Examples
    --------
    >>> import numpy as np
    >>> value, gradient, _ = log_sum_exp(np.zeros(4), 2.0)
    >>> round(value, 4), gradient.tolist()
    (0.6931, [0.25, 0.25, 0.25, 0.25])
    """
    value = float(scipy.special.logsumexp(power * logs)) / abs(power)
    weights = scipy.special.softmax(power * logs)
    sign = np.sign(power)
    hessian = abs(power) * (np.diag(weights) - np.multiply.outer(weights, weights))
    return value, sign * weights, hessian


def _inverse_power(logs: Array, level: float) -> tuple[float, Array, Array]:
    """Return log tr(F⁻ᵖ)/p, p = level."""
    return log_sum_exp(logs, -level)


def _mean_log(logs: Array, _level: float) -> tuple[float, Array, Array]:
    """Return −log det F / m."""
    m = logs.size
    return -float(np.mean(logs)), np.full(m, -1 / m), np.zeros((m, m))


def _spread(logs: Array, level: float) -> tuple[float, Array, Array]:
    """Return ½p⁻¹[log tr Fᵖ + log tr F⁻ᵖ], p = level."""
    high, high_slope, high_curvature = log_sum_exp(logs, level)
    low, low_slope, low_curvature = log_sum_exp(logs, -level)
    return (
        (high + low) / 2,
        (high_slope + low_slope) / 2,
        (high_curvature + low_curvature) / 2,
    )


OF_A_CHANGE = (
    "S is the information of the change of design.parameters since the machine of design.prior "
    "was identified"
)

_CRITERIA = (
    # The sum of the parameters' variances in the stated scaling.
    Criterion(
        key="a",
        title="trace of F⁻¹",
        larger_is_better=False,
        flat=True,
        levels=(1.0,),
        value=lambda eigenvalues: float(np.sum(1 / eigenvalues)),
        cost=_inverse_power,
        from_cost=lambda cost, _, samples, __: float(np.exp(cost) / samples),
    ),
    # The paper's deterministic design.
    Criterion(
        key="condition",
        title="condition number of F",
        larger_is_better=False,
        levels=(1.0, 4.0, 16.0),
        value=lambda eigenvalues: float(np.max(eigenvalues) / np.min(eigenvalues)),
        cost=_spread,
        from_cost=lambda cost, *_: float(np.exp(2 * cost)),
    ),
    # The volume of the confidence ellipsoid: no scaling of the parameters matters.
    Criterion(
        key="d",
        title="log det F",
        larger_is_better=True,
        invariant=True,
        levels=(0.0,),
        value=lambda eigenvalues: float(np.sum(np.log(eigenvalues))),
        cost=_mean_log,
        from_cost=lambda cost, count, samples, log_scale: float(
            count * (np.log(samples) - cost) - 2 * log_scale
        ),
    ),
    # The worst known combination of parameters in the stated scaling.
    Criterion(
        key="e",
        title="smallest eigenvalue of F",
        larger_is_better=True,
        flat=True,
        levels=(1.0, 4.0, 16.0),
        value=lambda eigenvalues: float(np.min(eigenvalues)),
        cost=_inverse_power,
        from_cost=lambda cost, _, samples, __: float(np.exp(-cost) * samples),
    ),
)


@cache
def criteria() -> Mapping[str, Criterion]:
    """Return every criterion by its key, in alphabetical order.

    A plug-in declares a further one as ``CRITERION``.

    Examples
    --------
    >>> criteria()["d"].title
    'log det F'
    """
    found = {one.key: one for one in (*_CRITERIA, *declarations(Criterion, None, "CRITERION"))}
    return MappingProxyType(dict(sorted(found.items())))
