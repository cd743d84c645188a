"""Nearest physically consistent parameters to an estimate, with a test of the difference.

The estimate p̂ with covariance C does not change. In addition p̃ is reported: in the metric C⁻¹ the
nearest parameters of rigid bodies of positive mass (`expdesign.mechanism.nearest`). For
base parameters p̃ is nearest in their combinations, and the parameters that regroup into them take
any consistent values. docs/consistency.md explains the test and the standard deviations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.estimators import ParameterEstimate, ParameterPriors
from estimation.uncertainty.intervals import interval_widths
from expdesign.information.identifiable import listed
from expdesign.mechanism.nearest import Nearest, NoBodiesError, Projection
from expdesign.robot import Robot
from expdesign.runfolder import Numbers, OpenNumbers, described

DRAWS = 199
"""Draws for the spread, and for the test if none of them is as distant as the estimate."""
MOST_DRAWS = 999
"""Largest number of draws for the test: with 199 fixed draws its level would be 5 ± 1.5 %."""
ENOUGH = 50
"""Draws as distant as the estimate after which the test ends: p is above its level."""
SIGNIFICANT = 0.05
SEED = 0
REPORTED_CHANGE = 0.01
"""Smallest reported change of a parameter without effect on the forces, in its scale."""
NEAR = 3.0
"""Distance, in standard deviations, below which the test treats a condition as active."""
_RARE = 0.01
"""Smallest p that is stated: the test ends before it can resolve smaller ones."""
_LEAST = 1e-3
"""Smallest distance, in σ, that is stated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyResult:
    """One body, in the frame of docs/model.md."""

    mass: Annotated[float, described("kg", "mass")]
    moment: Annotated[Numbers, described("kg m", "(3,) first moment about the frame's origin")]
    inertia: Annotated[
        Numbers, described("kg m^2", "3 × 3 about the frame's origin, products as matrix entries")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class ConsistentEstimate:
    """The nearest physically consistent parameters to an estimate."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    moved: Annotated[
        OpenNumbers,
        described("1", "(m,) values less estimate in σ, of base parameters by their combinations"),
    ]
    exchanged: Annotated[
        tuple[str, ...],
        described("", "held parameters with other values here; no force depends on them alone"),
    ]
    distance: Annotated[
        float, described("1", "from the estimate, standard deviations; 0: it is consistent")
    ]
    p: Annotated[float, described("1", "probability of such a distance if the truth is consistent")]
    significant: Annotated[bool, described("", "p is below 5 %")]
    active: Annotated[tuple[str, ...], described("", "active conditions and bounds")]
    spread: Annotated[
        OpenNumbers,
        described("SI", "(m,) root mean square error by simulation; null: fixed"),
    ]
    low: Annotated[OpenNumbers, described("SI", "(m,) lower ends of the 95 % intervals")]
    high: Annotated[OpenNumbers, described("SI", "(m,) upper ends")]
    bodies: Annotated[
        dict[str, BodyResult],
        described("", "ring, stator, slider and platform with these values: one of many sets"),
    ]
    text: Annotated[str, described("", "in words")] = ""

    @property
    def vector(self) -> Array:
        """(m,), the parameters, SI; identical to the estimate if that is consistent."""
        return np.array(list(self.values.values()))

    @property
    def realisable(self) -> bool:
        """Whether the estimate (of base parameters: its combinations) is consistent."""
        return self.distance == 0


def consistent_estimate(
    robot: Robot, estimate: ParameterEstimate, priors: ParameterPriors
) -> ConsistentEstimate | None:
    """Return the nearest consistent parameters; None if the fixed parameters exclude any.

    Fixed parameters keep their values, and the run's bounds are respected.
    """
    own = robot.realisable
    consistent_set = replace(
        own,
        lower=np.maximum(own.lower, priors.lower),
        upper=np.minimum(own.upper, priors.upper),
    )
    std = estimate.std
    free = priors.free & (std > 0) & np.isfinite(std)
    projection = Projection.by(estimate.covariance, consistent_set, free, priors.regrouping)
    nearest = _nearest(projection, estimate.values)
    if nearest is None:
        return None
    half = interval_widths(estimate.freedom) * np.where(free, std, np.nan)
    p, spread = 1.0, np.where(free, std, np.nan)
    if nearest.distance > 0:
        rng = np.random.default_rng(SEED)
        draws = rng.standard_normal((MOST_DRAWS, int(np.count_nonzero(free))))
        freedom = float(np.min(estimate.freedom[free]))
        if np.isfinite(freedom):
            # The covariance is estimated: the distances scatter with it.
            draws *= np.sqrt(freedom / rng.chisquare(freedom, (MOST_DRAWS, 1)))
        errors = draws @ projection.factor.T
        null = least_favourable(projection, nearest.values)
        drawn = (_nearest(projection, null + error) for error in errors)
        # A draw whose nearest parameters the solver does not find counts as distant.
        p = monte_carlo_p(one is None or one.distance >= nearest.distance for one in drawn)
        found = (_nearest(projection, nearest.values + error) for error in errors[:DRAWS])
        consistent_errors = [
            projection.observable_change(one.values - nearest.values)
            for one in found
            if one is not None
        ]
        spread = np.where(free, np.sqrt(np.mean(np.square(consistent_errors), axis=0)), np.nan)
    change = nearest.values - estimate.values
    exchanged = np.flatnonzero(
        projection.regrouped & (np.abs(change) > REPORTED_CHANGE * robot.scales)
    )
    result = ConsistentEstimate(
        values=dict(zip(priors.names, nearest.values.tolist(), strict=True)),
        moved=projection.observable_change(change) / np.where(free, std, np.nan),
        exchanged=tuple(priors.names[k] for k in exchanged),
        distance=nearest.distance,
        p=p,
        significant=p <= SIGNIFICANT,
        active=nearest.active,
        spread=spread,
        low=np.maximum(nearest.values - half, consistent_set.lower),
        high=np.minimum(nearest.values + half, consistent_set.upper),
        bodies={name: BodyResult(**vars(body)) for name, body in vars(nearest.bodies).items()},
    )
    known = own.bodies(robot.parameters) is not None
    return replace(result, text=consistency_text(result, known=known))


def _nearest(projection: Projection, values: Array) -> Nearest | None:
    try:
        return projection.of(values)
    except NoBodiesError:
        return None


def consistency_text(found: ConsistentEstimate, *, known: bool) -> str:
    """Describe the consistency of an estimate; `known`: that of the robot file is given."""
    if found.exchanged:
        kind, others = "combinations", f" (with other values of {listed(found.exchanged)})"
    else:
        kind, others = "parameters", ""
    if found.realisable:
        return f"physically consistent: these {kind} belong to a possible set of bodies{others}"
    p = f"≤ {100 * found.p:.3g}" if found.p > _RARE else f"< {100 * _RARE:g}"
    distance = (
        f"not physically consistent: the nearest consistent {kind}{others} are "
        f"{max(found.distance, _LEAST):.2g} σ away (p {p} %), at the limit of "
        f"{', '.join(found.active)}"
    )
    if not found.significant:
        return f"{distance}: no reason for doubt"
    doubt = "the model may lack an effect, or a tolerance or the noise is stated too small"
    if not known:
        doubt = "a correct estimate of the robot file's parameters is inconsistent, as they are"
    return f"{distance}: {doubt}"


def monte_carlo_p(as_far: Iterator[bool]) -> float:
    """Return the p-value from draws that are at least as distant as the estimate, or not.

    Sequential (Besag and Clifford, Biometrika 78, 1991): it ends after `ENOUGH` such draws, or if
    none of the first `DRAWS` is one. A p-value far from the level need not be precise.
    """
    successes = count = 0
    for one in as_far:
        successes, count = successes + one, count + 1
        if successes == ENOUGH:
            return successes / count
        if count == DRAWS and not successes:
            break
    return (1 + successes) / (1 + count)


def least_favourable(projection: Projection, values: Array) -> Array:
    """Return the parameters, (m,), compatible with the data, for which the distance is largest.

    Every condition within 3 σ of being active is made active (the moment selection of Andrews and
    Soares, Econometrica 78, 2010). The parameters q that are subtracted are consistent themselves.
    Consistent parameters K form a convex cone, K + q ⊂ K: starting at p − q, every error ends at
    least as far from K as starting at p.
    """
    conditions, found = projection.among, values.copy()
    spread = np.linalg.norm(projection.noise, axis=1)
    for ends in (conditions.lower, conditions.upper):
        found = np.where(np.abs(found - ends) < NEAR * spread, ends, found)
    for combination, removed in conditions.thin:
        slack = float(combination @ found)
        if slack < NEAR * np.linalg.norm(combination @ projection.noise):
            found = found - slack * removed
    found = _remove_small_inertia(projection, found)
    nearest = _nearest(projection, np.where(projection.movable, found, values))
    return values if nearest is None else nearest.values


def _remove_small_inertia(projection: Projection, values: Array) -> Array:
    """Remove the platform's principal inertias that are smaller than their noise."""
    conditions = projection.among
    rest = conditions.with_lightest_sliders(values)
    if rest is None:
        return values
    eigenvalues, axes = np.linalg.eigh(rest)
    steps = [conditions.with_lightest_sliders(values + error) for error in projection.noise.T]
    slopes = [
        np.full(len(axes), np.inf) if step is None else np.diag(axes.T @ (step - rest) @ axes)
        for step in steps
    ]
    noise = np.linalg.norm(slopes, axis=0)
    small = eigenvalues < NEAR * noise
    return values - conditions.of_platform((axes[:, small] * eigenvalues[small]) @ axes[:, small].T)
