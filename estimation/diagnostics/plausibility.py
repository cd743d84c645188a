"""Whether estimates are what a machine can have, and of the size that was expected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption, Finding, listed
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from expdesign.mechanism.term import Parameter, parameters_of
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot

ORDER = 10.0
"""Factor between an estimate and what was expected from which it is not plausible."""
MATTERS = 0.1
"""Share of what the robot's mass and length make, below which a difference is no reason for doubt:
nobody knows the small parameters of a body to an order of magnitude."""
SIGMAS = 3.0

_OF_BODIES = frozenset({"kg", "kg m", "kg m^2"})
_LEVEL = float(stats.norm.sf(SIGMAS))
_KNOWN_WELL = 0.1
_ALIKE = 0.3
_MOST = 2 / 3
_FEWEST = 3
_TOLD = 4

_PLAUSIBLE = Assumption(
    "the estimates are what a machine can have",
    "the estimates are not those of such a machine",
    "look for a channel with a wrong sign (`data.force_constants`), forces or lengths in another "
    "unit (`data.units`), struts in another order than in the robot file, a wrong zero of a "
    "length (home offset), gravity that points the other way, and a-priori values of another "
    "machine",
)


@dataclass(frozen=True)
class _Doubt:
    """A parameter that is not plausible, why in words, and by how much the noise speaks."""

    name: str
    sentence: str
    p: float


def plausibility(robot: Robot, knowledge: Knowledge, estimate: ParameterEstimate) -> Finding:
    """Hold estimates against what bodies and friction can be, and against the a-priori values.

    What noise and tolerances may make, 3 σ, is left out. Not plausible are: less than no machine
    has (a negative mass, moment of inertia or friction); of masses, first moments and moments of
    inertia those that differ from the a-priori value by a factor of ten, or in sign, where the
    difference matters beside the robot's mass and length. Friction and springs may be of any size.
    """
    parameters = parameters_of(robot.terms)
    values, std = (part[: len(parameters)] for part in (estimate.values, estimate.std))
    judged = knowledge.free[: len(parameters)] & (std > 0) & np.isfinite(std)
    expected = np.array(robot.parameters)
    sizes = _sizes(robot, parameters)
    doubts: list[_Doubt] = []
    smallest = 1.0
    for k in np.flatnonzero(judged):
        freedom = float(estimate.freedom[k])
        for gap, sentence in _gaps(parameters[k], values[k], std[k], expected[k], sizes[k]):
            p = float(stats.t.sf(gap / std[k], freedom))
            smallest = min(smallest, p)
            if p < _LEVEL:
                doubts.append(_Doubt(parameters[k].name, sentence, p))
                break
    if not doubts:
        return _PLAUSIBLE.holds(
            "no mass, moment of inertia or friction is negative, and bodies are of the size that "
            "was expected",
            smallest,
            _LEVEL,
        )
    # The mass tells most of what is wrong.
    doubts.sort(key=lambda doubt: doubt.name != MASS)
    names = [doubt.name for doubt in doubts]
    told = "; ".join(doubt.sentence for doubt in doubts[:_TOLD])
    more = f"; and {len(doubts) - _TOLD} more" if len(doubts) > _TOLD else ""
    where = listed(names if len(names) <= _TOLD else [*names[:_TOLD], f"{len(names) - _TOLD} more"])
    advice = _likely(values, std, expected, judged)
    return _PLAUSIBLE.fails(f"{told}{more}", smallest, _LEVEL, where, advice)


def _gaps(
    parameter: Parameter, value: float, std: float, expected: float, size: float
) -> Iterator[tuple[float, str]]:
    """Yield by how much an estimate is beyond what is plausible, with words for it."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    found = f"{parameter.name} = {value:.3g} ± {std:.1g}{unit}"
    if np.isfinite(parameter.lower):
        yield parameter.lower - value, f"{found} is negative" if parameter.lower == 0 else found
    if parameter.unit not in _OF_BODIES or expected == 0:
        return
    if abs(value - expected) <= MATTERS * size:
        return
    against = f"{found} where {expected:.3g}{unit} was expected"
    yield abs(expected) / ORDER - abs(value), against
    yield abs(value) - ORDER * abs(expected), against
    if min(abs(value), abs(expected)) > MATTERS * size:
        yield -value * np.sign(expected), against


def _sizes(robot: Robot, parameters: Sequence[Parameter]) -> Array:
    """Return what mass and length of the robot make of every parameter of a body, SI."""
    mass = abs(robot.description.parameters.get(MASS, 0.0))
    powers = {"kg": 0, "kg m": 1, "kg m^2": 2}
    length = robot.characteristic_length
    return np.array([mass * length ** powers.get(one.unit, 0) for one in parameters])


def _likely(values: Array, std: Array, expected: Array, judged: NDArray[np.bool_]) -> str:
    """Return the advice: what makes all parameters wrong by one factor, where they are."""
    known = judged & (expected != 0) & (std < _KNOWN_WELL * np.abs(values))
    if np.count_nonzero(known) < _FEWEST:
        return ""
    ratios = values[known] / expected[known]
    factor = float(np.median(ratios))
    alike = np.mean(np.abs(ratios - factor) <= _ALIKE * abs(factor)) >= _MOST
    if not alike:
        return ""
    if factor < 0:
        return (
            f"nearly all parameters are about {factor:.2g} times what was expected: the sign of "
            "all forces is wrong (`data.force_constants`, or forces that are positive when they "
            "shorten), or gravity and z axis point the other way"
        )
    if factor < 1 / ORDER or factor > ORDER:
        return (
            f"nearly all parameters are about {factor:.2g} times what was expected: the forces are "
            "in another unit (currents taken for newtons, newtons for kilonewtons), or the force "
            f"constant (`data.force_constants`) is wrong by a factor of about {1 / factor:.2g}"
        )
    return ""
