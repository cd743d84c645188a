"""Prior information on the parameters: fixed values, prior distributions and bounds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from constraints.arrays import Array
from estimation.estimators.prior_estimate import PriorEstimate, UnloadedMachine
from estimation.measurement_model.motion import NormalEquations
from expdesign.configuration import ComputationError, InputError
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.robot import RobotDescription
from expdesign.information.fisher import ScaledInformation
from expdesign.information.identifiable import (
    BaseParameters,
    KnownCombination,
    identified_base,
    known_combinations,
    listed,
    root_of_inverse,
)
from expdesign.mechanism.terms import known_parameters
from expdesign.recheck.excitable import structural_base
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, estimated_constants

_SAME = 1e-9
"""Relative difference, in scales of the parameter, below which two values are equal."""


class UnidentifiableError(ComputationError):
    """Some parameters are not determined by the data.

    Attributes
    ----------
    names : tuple of str
        Parameters to fix, or to give a prior, so that the others can be estimated.
    shows : tuple of str
        Combinations with other parameters that the data determine, in words.
    """

    def __init__(self, names: tuple[str, ...], shows: tuple[str, ...] = ()) -> None:
        self.names, self.shows = names, shows
        instead = f", only {listed(shows)}" if shows else ""
        remedy = (
            "Fix them (estimate.fixed), give a prior (estimate.prior), or, if no motion of the "
            "machine can separate them, estimate base parameters (estimate.parameters: base)"
        )
        if not set(names) <= set(known_parameters()):
            remedy = (
                "Fix parameters (estimate.fixed), do not estimate constants of terms (estimate: "
                "false), or give a prior (estimate.prior, tolerances.terms)"
            )
        super().__init__(
            f"the data do not determine {', '.join(names)}{instead}. The information matrix is "
            f"singular. {remedy}",
            {"undetermined": list(names), "shows": list(shows)},
        )

    def __reduce__(self) -> tuple[type[UnidentifiableError], tuple[tuple[str, ...], ...]]:
        """Support pickling, so that worker processes can raise it in their parent."""
        return type(self), (self.names, self.shows)


@dataclass(frozen=True, eq=False)
class ParameterPriors:
    """Priors, bounds and fixed values of the m parameters, SI."""

    names: tuple[str, ...]
    nominal: Array
    """(m,), a-priori values of the robot file, shown with the estimates."""
    free: NDArray[np.bool_]
    """(m,), false: fixed at `start`."""
    start: Array
    """(m,), start values; fixed parameters keep them."""
    prior_mean: Array
    """(m,), prior mean of the free parameters, given the values of the fixed ones."""
    prior_precision: Array
    """(m,), 1/std² of the prior; 0 without one."""
    lower: Array
    upper: Array
    """(m,), bounds; ±inf if there is none."""
    base: BaseParameters | None = None
    """Base parameters that replace all parameters that are not fixed; None: each is estimated."""
    prior_estimate: PriorEstimate | None = None
    """Earlier estimate that is a prior, in addition to `prior_precision`."""

    @classmethod
    def of(cls, robot: Robot, section: EstimateSection) -> ParameterPriors:
        """Read the run's `estimate:` section; the loader has checked its names.

        Raises
        ------
        InputError
            A prior or bound refers to a parameter that regroups into others (`base`).
        """
        known, nominal = robot.parameter_names, np.array(robot.parameters)
        prior_estimate = PriorEstimate.of(robot) if section.prior_from == "robot" else None
        fixed: Mapping[str, float | None] = section.fixed
        given_priors, bounds = section.named_priors, section.bounds
        lower, upper = np.transpose([bounds.get(name, (-np.inf, np.inf)) for name in known])

        def values(given: Mapping[str, float | None]) -> Array:
            """Return the nominal values, replaced by the given ones."""
            chosen = [given.get(name) for name in known]
            return np.array([n if c is None else c for n, c in zip(nominal, chosen, strict=True)])

        own, start = tuple(name for name in known if name not in fixed), values(fixed)
        if prior_estimate is not None:
            _refuse_held_elsewhere(prior_estimate, robot, section.fixed, start)
        base = structural_base(robot, own) if section.parameters == "base" and own else None
        if base is not None:
            _refuse_of_combinations(section, base)
            own = base.base
            prior_estimate = (
                None
                if prior_estimate is None
                else prior_estimate.of_combinations(base, known, start)
            )
        free = np.array([name in own for name in known])
        whole = cls(
            names=known,
            nominal=nominal,
            free=free,
            start=start,
            prior_mean=values({name: prior.value for name, prior in given_priors.items()})
            if prior_estimate is None
            else prior_estimate.conditional_mean(~free, start)[: len(known)],
            prior_precision=np.array(
                [given_priors[n].std ** -2 if n in given_priors else 0.0 for n in known]
            ),
            lower=lower,
            upper=upper,
            base=base,
            prior_estimate=prior_estimate,
        )
        if not isinstance(section.prior, RobotDescription):
            return whole
        # The machine carries an unknown payload now. Parameters that its identification held remain
        # at their values.
        before = UnloadedMachine.read(robot, section.prior)
        start = before.values[: len(known)].copy()
        start[before.platform] = whole.start[before.platform]
        free = before.is_estimated[: len(known)]
        return replace(whole, free=free, start=start, prior_mean=start, prior_estimate=before)

    def with_deviations(self, deviations: Sequence[Deviation]) -> ParameterPriors:
        """Append entries of θ to the parameters, with their tolerances as priors.

        For the first of them a prior estimate replaces the tolerance, if there is one.
        """
        count = len(deviations)
        zero, endless, mean = np.zeros(count), np.full(count, np.inf), np.zeros(count)
        if self.prior_estimate is not None:
            known = self.prior_estimate.conditional_mean(~self.free, self.start)[len(self.free) :]
            mean[: len(known)] = known
        std = np.array([each.tolerance for each in deviations])
        appended = {
            "nominal": zero,
            "free": np.ones(count, dtype=bool),
            "start": zero,
            "prior_mean": mean,
            "prior_precision": std**-2,
            "lower": np.array([each.lower for each in deviations]),
            "upper": endless,
        }
        wider: dict[str, Any] = {
            key: np.concatenate([getattr(self, key), own]) for key, own in appended.items()
        }
        return replace(self, names=(*self.names, *(one.name for one in deviations)), **wider)

    def constants(self, robot: Robot) -> tuple[Deviation, ...]:
        """Return the estimated constants of terms with their tolerances.

        A prior estimate replaces the tolerances: the robot file's tolerances contain its remaining
        uncertainty, which must not count twice.
        """
        found = estimated_constants(robot)
        if self.prior_estimate is None:
            return found
        return tuple(replace(one, tolerance=np.inf) for one in found)

    def constants_and(self, others: Sequence[Deviation], robot: Robot) -> tuple[Deviation, ...]:
        """Return the estimated constants of terms, then the others of them."""
        constants = self.constants(robot)
        named = {one.name for one in constants}
        return (*constants, *(one for one in others if one.name not in named))

    def prior_share(self, inverse: Array, parameters: int) -> Array:
        """Return the covariance due to errors of the priors, (k, k), from F⁻¹, (k, k).

        Tolerances of the entries after the m parameters are left out: they are systematic.
        """
        own = np.where(np.arange(len(self.names)) < parameters, self.prior_precision, 0.0)
        return inverse @ replace(self, prior_precision=own).precision @ inverse

    @property
    def has_bounds(self) -> bool:
        """Whether any free parameter has a bound."""
        ends = np.isfinite(self.lower) | np.isfinite(self.upper)
        return bool(np.any(ends & self.free))

    @property
    def precision(self) -> Array:
        """(k, k), prior information on the free parameters."""
        own = np.diag(self.prior_precision)
        if self.prior_estimate is not None:
            # If the constants are not unknowns, the precision given their values.
            count = min(len(own), len(self.prior_estimate.precision))
            own[:count, :count] += self.prior_estimate.precision[:count, :count]
        return own[np.ix_(self.free, self.free)]

    def equations(self, values: Array) -> NormalEquations:
        """Return the prior as normal equations of the free parameters at values, (m,)."""
        off, precision = (self.prior_mean - values)[self.free], self.precision
        return NormalEquations(float(off @ precision @ off), precision, precision @ off)

    @property
    def regrouping(self) -> Array | None:
        """(m, m), matrix from p to β for base parameters, to 0 for regrouped ones, else to p.

        None if all parameters are estimated individually.
        """
        return None if self.base is None else self.base.regrouping(self.names)

    def at_bound(self, values: Array) -> NDArray[np.bool_]:
        """Return which of the parameters, (m,), are at one of their bounds."""
        return self.free & ((values <= self.lower) | (values >= self.upper))

    def best_step(self, information: Array, gradient: Array, values: Array) -> Array:
        """Return the step of the free parameters that maximises gᵀs − ½ sᵀ F s within the bounds.

        F, (k, k), and g, (k,), refer to the free parameters, priors included; the step starts at
        `values`, (m,). A singular F is refused as by `scale_information`.
        """
        scaled = self.scale_information(information)
        factor = np.asarray(sla.cholesky(scaled.matrix))
        target = sla.solve_triangular(factor, gradient / scaled.scales, trans="T")
        if not self.has_bounds:
            return np.asarray(sla.solve_triangular(factor, target)) / scaled.scales
        low = (self.lower - values)[self.free] * scaled.scales
        high = (self.upper - values)[self.free] * scaled.scales
        found = lsq_linear(factor, target, (low, high), method="bvls", tol=1e-14)
        return np.asarray(np.clip(found.x, low, high)) / scaled.scales

    def scale_information(self, information: Array) -> ScaledInformation:
        """Scale the information F of the free parameters to unit diagonal.

        Raises
        ------
        UnidentifiableError
            F is singular to working precision.
        """
        scaled = ScaledInformation.of(information)
        if scaled.is_singular():
            free = tuple(n for n, is_free in zip(self.names, self.free, strict=True) if is_free)
            directions = scaled.weak_directions(free)
            shows = dict.fromkeys(text for one in directions for text in one.shows)
            raise UnidentifiableError(tuple(one.name for one in directions), tuple(shows))
        return scaled

    def inverse(self, information: Array) -> Array:
        """Return F⁻¹ of the free parameters, (k, k), computed with scaling for accuracy."""
        scaled = self.scale_information(information)
        factor = sla.cho_factor(scaled.matrix)
        inverse = sla.cho_solve(factor, np.eye(len(scaled.scales)))
        return inverse / np.multiply.outer(scaled.scales, scaled.scales)

    def identified_combinations(
        self, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        """Return the identified combinations of an estimate and the parameters in them.

        The covariance, (m, m), is zero for parameters that were not estimated.
        """
        own = np.flatnonzero(self.free)
        names = tuple(self.names[k] for k in own)
        root = root_of_inverse(covariance[np.ix_(own, own)])
        found = identified_base(root, names, robot.scales[own])
        return self._known_combinations(found, robot, values, covariance)

    def inseparable_combinations(
        self, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        """Return only the combinations that no motion of the machine can separate."""
        if self.base is None:
            return ()
        rows = self._known_combinations(
            BaseParameters.each(self.base.base), robot, values, covariance
        )
        return tuple(row for row in rows if row.regrouped)

    def _known_combinations(
        self, found: BaseParameters, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        structure = BaseParameters.each(found.names) if self.base is None else self.base
        return known_combinations(found, structure, self.names, values, covariance, robot.scales)

    def expand(self, block: Array) -> Array:
        """Expand a (k, k) matrix of the free parameters to (m, m), zeros for the fixed ones."""
        result = np.zeros((len(self.names), len(self.names)))
        result[np.ix_(self.free, self.free)] = block
        return result


def _refuse_held_elsewhere(
    prior_estimate: PriorEstimate, robot: Robot, fixed: Iterable[str], start: Array
) -> None:
    """Refuse a prior estimate in which a parameter was held at another value than now.

    Its mean of the other parameters is conditional on that value, and their covariance with the
    held parameter is unknown.
    """
    held = np.diag(prior_estimate.precision)[: len(start)] == 0
    apart = np.abs(start - prior_estimate.values[: len(start)]) > _SAME * robot.scales
    for name in fixed:
        at = robot.parameter_names.index(name)
        if held[at] and apart[at]:
            raise InputError(
                f"{name} is fixed at {start[at]:g}, but the prior estimate held it at "
                f"{prior_estimate.values[at]:g}: its other values depend on that",
                key=f"estimate.fixed.{name}",
                allowed=f"{prior_estimate.values[at]:g}, or estimate.prior_from: none",
            )


def _refuse_of_combinations(section: EstimateSection, base: BaseParameters) -> None:
    """Refuse priors and bounds of parameters that are identified only in combinations."""
    for key, given in (("prior", section.named_priors), ("bounds", section.bounds)):
        for name in (name for name in given if name in base.names):
            shown = [base.text(one) for one in base.base if name in (one, *base.members(one))]
            if name in base.regrouped or shown != [name]:
                what = f"shows only in {listed(shown)}" if shown else "has no effect on the forces"
                raise InputError(
                    f"{name} {what}, and estimate.parameters is base: it is not estimated alone",
                    key=f"estimate.{key}.{name}",
                    allowed="estimate.parameters: all; or neither prior nor bounds of it",
                )
