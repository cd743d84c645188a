"""What is known of the parameters besides the data: fixed values, priors and bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from constraints.arrays import Array
from estimation.estimators.earlier import EarlierEstimate
from expdesign.configuration import ComputationError
from expdesign.configuration.sections.data import EstimateSection
from expdesign.information.fisher import ScaledInformation
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation


class UnidentifiableError(ComputationError):
    """The data do not determine some parameters at all.

    Attributes
    ----------
    names : tuple of str
        Parameters to fix, or to give a prior, so that the others can be estimated.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        super().__init__(
            f"the data do not determine {', '.join(names)}: the information matrix is singular. "
            "Fix them (estimate.fixed) or give a prior (estimate.prior)",
            {"undetermined": list(names)},
        )

    def __reduce__(self) -> tuple[type[UnidentifiableError], tuple[tuple[str, ...]]]:
        """Survive the way from a worker process to its parent."""
        return type(self), (self.names,)


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Constraints and priors on the m parameters, SI."""

    names: tuple[str, ...]
    nominal: Array
    """(m,), a-priori values of the robot file, shown beside the estimates."""
    free: NDArray[np.bool_]
    """(m,), false: fixed at `start`."""
    start: Array
    """(m,), values to begin from; those of the fixed parameters are kept."""
    prior_mean: Array
    """(m,)."""
    prior_precision: Array
    """(m,), 1/std²; 0 without a prior."""
    lower: Array
    upper: Array
    """(m,), bounds; ±inf where there is none."""
    earlier: EarlierEstimate | None = None
    """An estimate that is the prior, beside those of `prior_precision`."""

    @classmethod
    def of(cls, robot: Robot, section: EstimateSection) -> Knowledge:
        """Take what the run's `estimate:` section says, whose names the loader has checked."""
        known, nominal = robot.parameter_names, np.array(robot.parameters)
        earlier = EarlierEstimate.of(robot) if section.prior_from == "robot" else None
        fixed: Mapping[str, float | None] = section.fixed
        priors, bounds = section.prior, section.bounds
        lower, upper = np.transpose([bounds.get(name, (-np.inf, np.inf)) for name in known])

        def values(given: Mapping[str, float | None]) -> Array:
            """Return the nominal values but for those given."""
            chosen = [given.get(name) for name in known]
            return np.array([n if c is None else c for n, c in zip(nominal, chosen, strict=True)])

        return cls(
            names=known,
            nominal=nominal,
            free=np.array([name not in fixed for name in known]),
            start=values(fixed),
            prior_mean=values({name: prior.value for name, prior in priors.items()})
            if earlier is None
            else earlier.values,
            prior_precision=np.array([priors[n].std ** -2 if n in priors else 0.0 for n in known]),
            lower=lower,
            upper=upper,
            earlier=earlier,
        )

    def with_deviations(self, deviations: Sequence[Deviation]) -> Knowledge:
        """Return it with entries of θ behind the parameters: their tolerances are priors."""
        count = len(deviations)
        zero, endless = np.zeros(count), np.full(count, np.inf)
        std = np.array([each.std for each in deviations])
        behind = {
            "nominal": zero,
            "free": np.ones(count, dtype=bool),
            "start": zero,
            "prior_mean": zero,
            "prior_precision": std**-2,
            "lower": -endless,
            "upper": endless,
        }
        wider: dict[str, Any] = {
            key: np.concatenate([getattr(self, key), own]) for key, own in behind.items()
        }
        return replace(self, names=(*self.names, *(one.name for one in deviations)), **wider)

    @property
    def bounded(self) -> bool:
        """True when a free parameter has a bound."""
        ends = np.isfinite(self.lower) | np.isfinite(self.upper)
        return bool(np.any(ends & self.free))

    @property
    def precision(self) -> Array:
        """(k, k) prior information of the free parameters."""
        own = np.diag(self.prior_precision)
        if self.earlier is not None:
            count = len(self.earlier.precision)
            own[:count, :count] += self.earlier.precision
        return own[np.ix_(self.free, self.free)]

    def at_bound(self, values: Array) -> NDArray[np.bool_]:
        """Tell which of the parameters, (m,), stand at one of their bounds."""
        return self.free & ((values <= self.lower) | (values >= self.upper))

    def best_step(self, information: Array, gradient: Array, values: Array) -> Array:
        """Return the step of the free parameters that maximises gᵀs − ½ sᵀ F s within the bounds.

        F, (k, k), and g, (k,), are those of the free parameters, priors included; the step begins
        at `values`, (m,).

        Raises
        ------
        UnidentifiableError
            F is singular.
        """
        scaled = self.regular(information)
        factor = np.asarray(sla.cholesky(scaled.matrix))
        target = sla.solve_triangular(factor, gradient / scaled.scales, trans="T")
        if not self.bounded:
            return np.asarray(sla.solve_triangular(factor, target)) / scaled.scales
        low = (self.lower - values)[self.free] * scaled.scales
        high = (self.upper - values)[self.free] * scaled.scales
        found = lsq_linear(factor, target, (low, high), method="bvls", tol=1e-14)
        return np.asarray(np.clip(found.x, low, high)) / scaled.scales

    def regular(self, information: Array) -> ScaledInformation:
        """Return F of the free parameters scaled to unit diagonal.

        Raises
        ------
        UnidentifiableError
            F is singular to working precision.
        """
        scaled = ScaledInformation.of(information)
        if scaled.is_singular():
            free = tuple(n for n, is_free in zip(self.names, self.free, strict=True) if is_free)
            raise UnidentifiableError(scaled.unexcited(free))
        return scaled

    def inverse(self, information: Array) -> Array:
        """Return F⁻¹ of the free parameters, (k, k), scaled so that no digits are lost."""
        scaled = self.regular(information)
        factor = sla.cho_factor(scaled.matrix)
        inverse = sla.cho_solve(factor, np.eye(len(scaled.scales)))
        return inverse / np.multiply.outer(scaled.scales, scaled.scales)

    def full(self, block: Array) -> Array:
        """Return a (k, k) matrix of the free parameters as (m, m), zeros for the fixed ones."""
        result = np.zeros((len(self.names), len(self.names)))
        result[np.ix_(self.free, self.free)] = block
        return result
