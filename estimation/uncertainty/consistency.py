"""Estimates beside the nearest ones that some set of bodies has, and what the difference means.

The estimate p̂ with covariance C stays as it is; beside it stands p̃, the nearest parameters in the
metric C⁻¹ that bodies have (`expdesign.mechanism.nearest`). Of base parameters these are the
nearest combinations; what regroups into them takes whatever value bodies need. docs/consistency.md
tells why the test and the standard deviations are what they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from estimation.estimators import ParameterEstimate, ParameterPriors
from estimation.uncertainty.intervals import interval_widths
from expdesign.mechanism.bodies import MachineBodies
from expdesign.mechanism.nearest import NoBodiesError, Projection
from expdesign.robot import Robot

DRAWS = 199
"""Of the spread; and of the test where none of these goes as far as the estimate."""
MOST_DRAWS = 999
"""Of the test: with 199 that are the same in every run it has a level of 5 ± 1.5 %."""
ENOUGH = 50
"""Draws as far as the estimate after which the test needs no more: p is above its level."""
SIGNIFICANT = 0.05
SEED = 0
TOLD = 0.01
"""Share of its scale from which the change of a parameter that no force shows is told."""
NEAR = 3.0
"""Standard deviations within which a condition may be tight in truth: the test takes it so."""


@dataclass(frozen=True, eq=False)
class ConsistentEstimate:
    """The nearest parameters to an estimate that some bodies have."""

    estimator: str
    values: Array
    """(m,), SI; the estimate itself, bit by bit, where bodies have it."""
    moved: Array
    """(m,), p̃ − p̂ in standard deviations; of a base parameter what its combination moved by. NaN:
    not estimated."""
    exchanged: tuple[str, ...]
    """The parameters with other values than they were held at, since no force shows which."""
    distance: float
    """√((p̂ − p̃)ᵀ C⁻¹ (p̂ − p̃)), standard deviations; of the combinations where p regroups."""
    p: float
    """How often noise makes such a distance at least, where bodies have the true parameters."""
    active: tuple[str, ...]
    """The conditions and bounds that p̃ stands at."""
    bodies: MachineBodies
    """Which have p̃."""
    spread: Array
    """(m,), root mean square error of p̃ where it is the truth; std where bodies have p̂."""
    low: Array
    high: Array
    """(m,), 95 % intervals: of the estimate's width about p̃, within the bounds."""

    @property
    def realisable(self) -> bool:
        """Whether bodies have the estimate: of base parameters, these combinations."""
        return self.distance == 0

    @property
    def significant(self) -> bool:
        """Whether noise alone hardly makes the distance."""
        return self.p <= SIGNIFICANT


def consistent_estimate(
    robot: Robot, estimate: ParameterEstimate, priors: ParameterPriors
) -> ConsistentEstimate | None:
    """Return the nearest parameters that bodies have; None where what is fixed leaves none.

    Fixed parameters stay, and bounds of the run are kept, too.
    """
    own = robot.realisable
    among = replace(
        own,
        lower=np.maximum(own.lower, priors.lower),
        upper=np.minimum(own.upper, priors.upper),
    )
    std = estimate.std
    free = priors.free & (std > 0) & np.isfinite(std)
    projection = Projection.by(estimate.covariance, among, free, priors.regrouping)
    try:
        nearest = projection.of(estimate.values)
    except NoBodiesError:
        return None
    half = interval_widths(estimate.freedom) * np.where(free, std, np.nan)
    p, spread = 1.0, np.where(free, std, np.nan)
    if nearest.distance > 0:
        rng = np.random.default_rng(SEED)
        draws = rng.standard_normal((MOST_DRAWS, int(np.count_nonzero(free))))
        freedom = float(np.min(estimate.freedom[free]))
        if np.isfinite(freedom):
            # The covariance is estimated: distances are measured with one that scatters.
            draws *= np.sqrt(freedom / rng.chisquare(freedom, (MOST_DRAWS, 1)))
        moves = draws @ projection.factor.T
        null = tightest(projection, nearest.values)
        farther = (projection.of(null + move).distance >= nearest.distance for move in moves)
        p = monte_carlo_p(farther)
        errors = [
            projection.told(projection.of(nearest.values + move).values - nearest.values)
            for move in moves[:DRAWS]
        ]
        spread = np.where(free, np.sqrt(np.mean(np.square(errors), axis=0)), np.nan)
    change = nearest.values - estimate.values
    exchanged = np.flatnonzero(projection.regrouped & (np.abs(change) > TOLD * robot.scales))
    return ConsistentEstimate(
        estimator=estimate.estimator,
        values=nearest.values,
        moved=projection.told(change) / np.where(free, std, np.nan),
        exchanged=tuple(priors.names[k] for k in exchanged),
        distance=nearest.distance,
        p=p,
        active=nearest.active,
        bodies=nearest.bodies,
        spread=spread,
        low=np.maximum(nearest.values - half, among.lower),
        high=np.minimum(nearest.values + half, among.upper),
    )


def monte_carlo_p(farther: Iterator[bool]) -> float:
    """Return the p value of which draws went at least as far as what was found.

    It ends with the draw that makes them enough (Besag and Clifford, Biometrika 78, 1991), or
    where none of the first went as far: a p value that is clearly above or below the level need
    not be known as well as one near it.
    """
    as_far = count = 0
    for one in farther:
        as_far, count = as_far + one, count + 1
        if as_far == ENOUGH:
            return as_far / count
        if count == DRAWS and not as_far:
            break
    return (1 + as_far) / (1 + count)


def tightest(projection: Projection, values: Array) -> Array:
    """Return the parameters, (m,), from which noise goes farthest of those that may be the truth.

    Every condition within 3 σ of being tight is made so (Andrews and Soares, Econometrica 78, 2010,
    choose the conditions that count in this way). What is taken off are parameters q of bodies, and
    the parameters of bodies K are a convex cone, K + q ⊂ K: from p − q every move ends at least as
    far from K as from p.
    """
    among, found = projection.among, values.copy()
    spread = np.linalg.norm(projection.noise, axis=1)
    for ends in (among.lower, among.upper):
        found = np.where(np.abs(found - ends) < NEAR * spread, ends, found)
    for combination, removed in among.thin:
        slack = float(combination @ found)
        if slack < NEAR * np.linalg.norm(combination @ projection.noise):
            found = found - slack * removed
    found = _flat(projection, found)
    found = np.where(projection.movable, found, values)
    try:
        return projection.of(found).values
    except NoBodiesError:
        return values


def _flat(projection: Projection, values: Array) -> Array:
    """Return parameters without what of the platform may be noise."""
    among = projection.among
    rest = among.beside_sliders(values)
    if rest is None:
        return values
    eigenvalues, axes = np.linalg.eigh(rest)
    steps = [among.beside_sliders(values + move) for move in projection.noise.T]
    slopes = [
        np.full(len(axes), np.inf) if step is None else np.diag(axes.T @ (step - rest) @ axes)
        for step in steps
    ]
    noise = np.linalg.norm(slopes, axis=0)
    small = eigenvalues < NEAR * noise
    return values - among.of_platform((axes[:, small] * eigenvalues[small]) @ axes[:, small].T)
