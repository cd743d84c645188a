"""How what is not known exactly moves an estimate: the systematic share of its covariance.

A machine that deviates by θ from its description moves the estimate by D θ. Over all experiments
D = Σ K_fᵀ Z_f + K_lᵀ Z_l, with the estimator's own K (`estimation.estimators.influence`). By the
tolerances θ has the covariance Θ, and D Θ Dᵀ is what they make (GUM, type B). θ is one and the
same in all recordings of the machine: D is summed before it is squared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.deviating import DeviatingMachine, MeasuredForces, MeasuredLengths
from estimation.estimators.earlier import EarlierEstimate
from estimation.estimators.influence import Influence
from expdesign.robot.deviation import Deviation


@dataclass(frozen=True, eq=False)
class Systematic:
    """What the deviations θ of a machine do to an estimate, and what is known of them."""

    deviations: tuple[Deviation, ...]
    response: Array
    """(m, t), D: what p̂ moves by per unit of every entry; zero for fixed parameters."""
    values: Array
    """(t,), estimate of θ; zero where it is not estimated."""
    std: Array
    """(t,), its standard deviation: the tolerance where it is not estimated."""
    estimated: bool = False
    """θ was estimated together with the parameters."""
    left: Array | None = None
    """(t, t), what θ̂ − θ moves by per unit of every entry: −1 on the diagonal of one that was not
    estimated, and what the data leave to the prior of one that was. No row of its own has an entry
    that repeats another's name: the error of an earlier prior. None in an estimate that was saved
    by an earlier version."""

    @property
    def scaled(self) -> Array:
        """(m, t), D times the tolerances: what one standard deviation of every entry does.

        Zero of an entry that was estimated without a prior: nothing of it is left but noise.
        """
        return self.response * self._tolerances

    @property
    def joint_scaled(self) -> Array:
        """(m + t, t), the same of (p̂ − p, θ̂ − θ)."""
        if self.left is None:
            raise ValueError("an earlier version did not save what is left of θ")
        return np.concatenate([self.response, self.left]) * self._tolerances

    @property
    def _tolerances(self) -> Array:
        std = np.array([each.std for each in self.deviations])
        return np.where(np.isfinite(std), std, 0.0)

    @property
    def with_priors(self) -> bool:
        """Whether something that has a tolerance was estimated."""
        known = [
            std != one.std < np.inf for one, std in zip(self.deviations, self.std, strict=True)
        ]
        return self.estimated and any(known)

    @property
    def inexact(self) -> bool:
        """Whether anything has a tolerance."""
        return any(np.isfinite(one.std) for one in self.deviations)

    @property
    def covariance(self) -> Array:
        """(m, m), D Θ Dᵀ."""
        return self.scaled @ self.scaled.T


def systematic_share(
    influences: Sequence[Influence],
    chosen: Sequence[Deviation],
    free: NDArray[np.bool_],
    values: Array | None = None,
) -> Systematic | None:
    """Return what the entries chosen do to an estimate.

    None after pointwise kinematics, where it is not known how lengths move the estimate.

    Parameters
    ----------
    influences : sequence of Influence
        Of every experiment of the estimate.
    chosen : sequence of Deviation
        At least one; all that were estimated together with the parameters are the first of them.
    free : (m,) of bool
        Parameters that were estimated.
    values : (t,), optional
        Estimate of θ, where it was estimated.

    Notes
    -----
    Where θ is estimated with its tolerances as priors, D = −(F⁻¹)_pθ Θ⁻¹: what the data leave to
    the prior. It follows from the same sum, as K then holds the columns of θ.
    """
    count = int(np.count_nonzero(free))
    moved = np.zeros((len(influences[0].force_gain), len(chosen)))
    for influence in influences:
        motion = influence.motion
        if motion is None or influence.length_gain is None:
            return None
        found = influence.machine or DeviatingMachine.exact(influence.robot)
        theta = dict(zip((one.name for one in found.chosen), found.theta.tolist(), strict=True))
        at = np.array([theta.get(one.name, 0.0) for one in chosen])
        machine = DeviatingMachine.of(influence.robot, chosen, at)
        known, jumps = (influence.experiment, motion), "delay" not in theta
        moved += influence.response(
            _moved(partial(machine.forces, *known, influence.values, jumps=jumps)),
            _moved(partial(machine.lengths, *known)),
        )
    response = np.zeros((len(free), len(chosen)))
    response[free], left = moved[:count], -np.eye(len(chosen))
    left[: len(moved) - count] += moved[count:]
    return Systematic(
        tuple(chosen),
        response,
        np.zeros(len(chosen)) if values is None else values,
        np.array([each.std for each in chosen]),
        estimated=values is not None,
        left=left,
    )


def with_prior(
    systematic: Systematic | None,
    influences: Sequence[Influence],
    earlier: EarlierEstimate,
    free: NDArray[np.bool_],
) -> Systematic | None:
    """Return what tolerances do to an estimate whose prior is an earlier one of the machine.

    The prior enters with the gain F⁻¹ P, (r, m + c): its errors of parameters that are held now
    move what it says of the others. An entry with the same tolerance is the same number in both.
    """
    if any(each.motion is None or each.length_gain is None for each in influences):
        return systematic
    count = int(np.count_nonzero(free))
    known = np.concatenate([free, np.ones(len(earlier.precision) - len(free), dtype=bool)])
    # The forces' gain on the columns of what is estimated is F⁻¹, in every experiment.
    gain = influences[0].force_gain[:, : np.count_nonzero(known)] @ earlier.precision[known]
    moved = gain @ earlier.response
    if systematic is None:
        if not any(one.std > 0 for one in earlier.deviations):
            return None
        nothing = np.zeros(0)
        systematic = Systematic(
            (), np.zeros((len(free), 0)), nothing, nothing, left=np.zeros((0, 0))
        )
    own, names = systematic.deviations, {one.name for one in systematic.deviations}
    places = {(one.name, one.std): place for place, one in enumerate(own)}
    others = [
        one for one in earlier.deviations if one.std > 0 and (one.name, one.std) not in places
    ]
    more = len(others)
    response = np.pad(systematic.response, ((0, 0), (0, more)))
    left = np.pad(np.asarray(systematic.left), (0, more))
    for place, one in enumerate(others, start=len(own)):
        places[one.name, one.std] = place
        left[place, place] = 0.0 if one.name in names else -1.0
        names.add(one.name)
    for one, column in zip(earlier.deviations, moved.T, strict=True):
        if (one.name, one.std) in places:
            place = places[one.name, one.std]
            response[free, place] += column[:count]
            left[: len(moved) - count, place] += column[count:]
    return replace(
        systematic,
        deviations=(*own, *others),
        response=response,
        left=left,
        values=np.concatenate([systematic.values, np.zeros(more)]),
        std=np.concatenate([systematic.std, [one.std for one in others]]),
    )


def _moved(
    measured: Callable[[slice], MeasuredForces | MeasuredLengths],
) -> Callable[[slice], Array]:
    """Return what gives the columns of θ at some of the samples."""
    return lambda part: measured(part).deviations
