"""What is known of the parameters besides the data: fixed values, priors and bounds."""

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
from expdesign.configuration import ComputationError, InputError
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.sections.estimate import EstimateSection
from expdesign.experiment.combinations import (
    KnownCombination,
    identified_base,
    known_combinations,
)
from expdesign.information.fisher import ScaledInformation
from expdesign.information.identifiable import BaseParameters, listed, root_of_inverse
from expdesign.mechanism.catalogue import known_parameters
from expdesign.recheck.excitable import structural_base
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, estimated_constants

_SAME = 1e-9
"""Share of its scale by which a value may differ and is the same."""


class UnidentifiableError(ComputationError):
    """The data do not determine some parameters at all.

    Attributes
    ----------
    names : tuple of str
        Parameters to fix, or to give a prior, so that the others can be estimated.
    shows : tuple of str
        The combinations with others that the data determine, in words.
    """

    def __init__(self, names: tuple[str, ...], shows: tuple[str, ...] = ()) -> None:
        self.names, self.shows = names, shows
        instead = f": what they show is {listed(shows)}" if shows else ""
        remedy = (
            "Fix them (estimate.fixed), give a prior (estimate.prior), or, where no motion of the "
            "machine tells them apart, estimate what shows (estimate.parameters: base)"
        )
        if not set(names) <= set(known_parameters()):
            remedy = (
                "Fix parameters (estimate.fixed), take constants of terms as they are (estimate: "
                "false), or give a prior (estimate.prior, tolerances.terms)"
            )
        super().__init__(
            f"the data do not determine {', '.join(names)}{instead}. The information matrix is "
            f"singular. {remedy}",
            {"undetermined": list(names), "shows": list(shows)},
        )

    def __reduce__(self) -> tuple[type[UnidentifiableError], tuple[tuple[str, ...], ...]]:
        """Survive the way from a worker process to its parent."""
        return type(self), (self.names, self.shows)


@dataclass(frozen=True, eq=False)
class ParameterPriors:
    """Constraints and priors on the m parameters, SI."""

    names: tuple[str, ...]
    nominal: Array
    """(m,), a-priori values of the robot file, shown beside the estimates."""
    free: NDArray[np.bool_]
    """(m,), false: fixed at `start`."""
    start: Array
    """(m,), values to begin from; those of the fixed parameters are kept."""
    prior_mean: Array
    """(m,), of the free parameters where the fixed ones stand."""
    prior_precision: Array
    """(m,), 1/std²; 0 without a prior."""
    lower: Array
    upper: Array
    """(m,), bounds; ±inf where there is none."""
    base: BaseParameters | None = None
    """Those that are estimated in place of all that are not fixed; None: each for itself."""
    prior_estimate: PriorEstimate | None = None
    """An estimate that is the prior, beside those of `prior_precision`."""

    @classmethod
    def of(cls, robot: Robot, section: EstimateSection) -> ParameterPriors:
        """Take what the run's `estimate:` section says, whose names the loader has checked.

        Raises
        ------
        InputError
            It says something of a parameter that regroups into others, which `base` leaves alone.
        """
        known, nominal = robot.parameter_names, np.array(robot.parameters)
        prior_estimate = PriorEstimate.of(robot) if section.prior_from == "robot" else None
        fixed: Mapping[str, float | None] = section.fixed
        given_priors, bounds = section.named_priors, section.bounds
        lower, upper = np.transpose([bounds.get(name, (-np.inf, np.inf)) for name in known])

        def values(given: Mapping[str, float | None]) -> Array:
            """Return the nominal values but for those given."""
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
        prior_estimate = PriorEstimate.without_payload(robot, section.prior)
        return (
            whole
            if prior_estimate.unloaded is None
            else whole.after(prior_estimate, prior_estimate.unloaded)
        )

    def after(self, prior_estimate: PriorEstimate, unloaded: UnloadedMachine) -> ParameterPriors:
        """Return it with the prior of a machine that carries an unknown payload now.

        What the identification held at a value stays there.
        """
        count = len(self.names)
        start = unloaded.values[:count].copy()
        start[unloaded.platform] = self.start[unloaded.platform]
        free = unloaded.known[:count]
        return replace(
            self, free=free, start=start, prior_mean=start, prior_estimate=prior_estimate
        )

    def with_deviations(self, deviations: Sequence[Deviation]) -> ParameterPriors:
        """Return it with entries of θ behind the parameters: their tolerances are priors.

        What an earlier estimate knows of the first of them stands in place of a tolerance.
        """
        count = len(deviations)
        zero, endless, mean = np.zeros(count), np.full(count, np.inf), np.zeros(count)
        if self.prior_estimate is not None:
            known = self.prior_estimate.conditional_mean(~self.free, self.start)[len(self.free) :]
            mean[: len(known)] = known
        std = np.array([each.std for each in deviations])
        behind = {
            "nominal": zero,
            "free": np.ones(count, dtype=bool),
            "start": zero,
            "prior_mean": mean,
            "prior_precision": std**-2,
            "lower": np.array([each.lower for each in deviations]),
            "upper": endless,
        }
        wider: dict[str, Any] = {
            key: np.concatenate([getattr(self, key), own]) for key, own in behind.items()
        }
        return replace(self, names=(*self.names, *(one.name for one in deviations)), **wider)

    def constants(self, robot: Robot) -> tuple[Deviation, ...]:
        """Return the constants of terms that are estimated, with their tolerances.

        Without these where an earlier estimate is the prior: it knows more, and what is left of it
        stands in the robot file as a tolerance, which is not to count twice.
        """
        found = estimated_constants(robot)
        if self.prior_estimate is None:
            return found
        return tuple(replace(one, std=np.inf) for one in found)

    def prior_share(self, inverse: Array, parameters: int) -> Array:
        """Return the covariance that errors of the priors make, (k, k), by F⁻¹, (k, k).

        Tolerances of what stands behind the m parameters have no part: they are systematic.
        """
        own = np.where(np.arange(len(self.names)) < parameters, self.prior_precision, 0.0)
        return inverse @ replace(self, prior_precision=own).precision @ inverse

    @property
    def bounded(self) -> bool:
        """True when a free parameter has a bound."""
        ends = np.isfinite(self.lower) | np.isfinite(self.upper)
        return bool(np.any(ends & self.free))

    @property
    def precision(self) -> Array:
        """(k, k) prior information of the free parameters."""
        own = np.diag(self.prior_precision)
        if self.prior_estimate is not None:
            # Without θ behind the parameters: what it says where the constants are held.
            count = min(len(own), len(self.prior_estimate.precision))
            own[:count, :count] += self.prior_estimate.precision[:count, :count]
        return own[np.ix_(self.free, self.free)]

    @property
    def regrouping(self) -> Array | None:
        """(m, m): β in place of each base parameter, nothing of those that regroup, else p.

        None where each is estimated for itself.
        """
        if self.base is None:
            return None
        at = [self.names.index(name) for name in self.base.names]
        own = [self.names.index(name) for name in self.base.base]
        found = np.eye(len(self.names))
        found[at] = 0.0
        found[np.ix_(own, at)] = self.base.matrix
        return found

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
            directions = scaled.weak_directions(free)
            shows = dict.fromkeys(text for one in directions for text in one.shows)
            raise UnidentifiableError(tuple(one.name for one in directions), tuple(shows))
        return scaled

    def inverse(self, information: Array) -> Array:
        """Return F⁻¹ of the free parameters, (k, k), scaled so that no digits are lost."""
        scaled = self.regular(information)
        factor = sla.cho_factor(scaled.matrix)
        inverse = sla.cho_solve(factor, np.eye(len(scaled.scales)))
        return inverse / np.multiply.outer(scaled.scales, scaled.scales)

    def combinations(
        self, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        """Return the combinations that an estimate identifies, with what regroups into them.

        Parameters
        ----------
        robot : Robot
            Whose scales tell what counts as one.
        values, covariance : (m,), (m, m)
            Of the estimate; zero covariance of what was not estimated.
        """
        own = np.flatnonzero(self.free)
        names = tuple(self.names[k] for k in own)
        root = root_of_inverse(covariance[np.ix_(own, own)])
        found = identified_base(root, names, robot.scales[own])
        return self._known(found, robot, values, covariance)

    def inseparable(
        self, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        """Return the same of the combinations alone that no motion of the machine tells apart."""
        if self.base is None:
            return ()
        rows = self._known(BaseParameters.each(self.base.base), robot, values, covariance)
        return tuple(row for row in rows if row.regrouped)

    def _known(
        self, found: BaseParameters, robot: Robot, values: Array, covariance: Array
    ) -> tuple[KnownCombination, ...]:
        structure = BaseParameters.each(found.names) if self.base is None else self.base
        scales = dict(zip(self.names, robot.scales.tolist(), strict=True))
        at = [self.names.index(name) for name in structure.names]
        return known_combinations(found, structure, values[at], covariance[np.ix_(at, at)], scales)

    def full(self, block: Array) -> Array:
        """Return a (k, k) matrix of the free parameters as (m, m), zeros for the fixed ones."""
        result = np.zeros((len(self.names), len(self.names)))
        result[np.ix_(self.free, self.free)] = block
        return result


def _refuse_held_elsewhere(
    prior_estimate: PriorEstimate, robot: Robot, fixed: Iterable[str], start: Array
) -> None:
    """Refuse a prior that held a parameter at another value than that it is fixed at now.

    What it says of the others is beside its own value, and it does not say how they go together.
    """
    held = np.diag(prior_estimate.precision)[: len(start)] == 0
    apart = np.abs(start - prior_estimate.values[: len(start)]) > _SAME * robot.scales
    for name in fixed:
        at = robot.parameter_names.index(name)
        if held[at] and apart[at]:
            raise InputError(
                f"{name} is {start[at]:g}, and the estimate that is the prior held it at "
                f"{prior_estimate.values[at]:g}: what it found of the others is beside that value",
                key=f"estimate.fixed.{name}",
                allowed=f"{prior_estimate.values[at]:g}, or estimate.prior_from: none",
            )


def _refuse_of_combinations(section: EstimateSection, base: BaseParameters) -> None:
    """Refuse priors and bounds of parameters that show only together with others."""
    for key, given in (("prior", section.named_priors), ("bounds", section.bounds)):
        for name in (name for name in given if name in base.names):
            shown = [base.text(one) for one in base.base if name in (one, *base.members(one))]
            if name in base.regrouped or shown != [name]:
                what = f"shows only in {listed(shown)}" if shown else "shows in nothing"
                raise InputError(
                    f"{name} {what}, and estimate.parameters is base: it is not estimated alone",
                    key=f"estimate.{key}.{name}",
                    allowed="estimate.parameters: all; or neither prior nor bounds of it",
                )
