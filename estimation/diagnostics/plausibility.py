"""Plausibility of estimates: physical consistency, expected size, and a common factor.

A common factor of all inertial parameters indicates another unit, or the wrong sign, of the forces.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import ndtr

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from expdesign.configuration.quantity import FORCE
from expdesign.mechanism.term import Lump, Parameter, parameters_of
from expdesign.mechanism.terms import DEFAULT
from expdesign.mechanism.terms.actuator_forces import DRIVE_INERTIA
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot

ORDER = 10.0
"""Factor between an estimate and its a-priori value from which it is not plausible."""
MATTERS = 0.1
"""Smallest relevant difference, relative to the robot's mass and length and to the largest value of
its kind. The a-priori values of small inertial parameters are hardly known to an order of
magnitude, and they absorb every error of the model first."""
SIGMAS = 3.0

_INERTIAL_UNITS = {"kg": 0, "kg m": 1, "kg m^2": 2}
"""Unit → power of the length."""
_LEVEL = float(ndtr(-SIGMAS))
_MOST_SHOWN = 4

_PLAUSIBLE = Assumption(
    "the estimates are plausible for a machine",
    "the estimates are not plausible for this machine",
    "look for a force with the wrong sign (`data.sign`), forces or lengths in another unit "
    "(`data.units`, `data.force_constants`), channels in another order than the struts "
    "(`data.order`), a wrong zero of a length (`data.offset`), gravity that points the other "
    "way, the inertia of motors and screws (`drive`), and a-priori values of another machine",
)

FORCE_SCALE = Assumption(
    "the forces have the expected sign and unit",
    "all forces are wrong by one factor",
    "check the force constants and the unit of the forces",
)

_FAR = 9.0
"""Factor that excludes another machine of the kind; kilograms instead of newtons give 9.8."""
_NEAR = 0.15
"""Tolerance, in the logarithm, between a factor and that of a unit: accuracy of masses."""
_LARGE = 2.5
_KNOWN_WELL = 0.1
_ALIKE = 0.3
_MOST = 2 / 3
_FEWEST = 2
"""Relative spread about a far factor, share of the parameters that have it, and their number."""
_OF_NEARBY = (0.1, 0.8, 4)
"""The same of a factor that another machine could have."""
_NEARBY = 1.25
"""Factor, or its inverse, within which a-priori masses are expected."""
_COMMON_FACTOR = "force_constant.common"
"""Key of the tolerance of a factor of all forces."""


@dataclass(frozen=True)
class _Doubt:
    """Implausible estimate: place, explanation, and p of the gap under noise."""

    where: str
    sentence: str
    p: float


def plausibility(robot: Robot, priors: ParameterPriors, estimate: ParameterEstimate) -> Finding:
    """Compare estimates with physical limits of bodies and friction, and with a-priori values.

    Gaps within 3 σ, which noise and tolerances may cause, are accepted. Not plausible are

    - values outside of physical limits: a negative mass or friction, or a negative moment of
      inertia of relevant size;
    - physically inconsistent masses, first moments and moments of inertia: a pseudo-inertia
      (`Lump`) that is not positive semidefinite;
    - inertial parameters that differ from the a-priori value by a factor of ten, or in sign, if the
      difference is relevant compared with the robot's mass and length and the largest of its kind;
    - inertial parameters that differ by a common factor, of ten or of a unit, or nearly all of them
      by any factor that masses of another machine of the kind do not share.

    Friction and springs may have any size.
    """
    parameters = parameters_of(robot.terms)
    values, std = estimate.values, estimate.std
    judged = priors.free & (std > 0) & np.isfinite(std)
    tests = [*_check_parameters(robot, parameters, estimate, judged)]
    alone = {test.where for test in tests if test.p < _LEVEL}
    # A fixed value is the user's choice.
    alone |= {
        parameter.name
        for parameter, value, free in zip(parameters, values, judged, strict=True)
        if not free and not parameter.lower <= value <= parameter.upper
    }
    tests += _check_lumps(robot, parameters, estimate, alone)
    doubts = [test for test in tests if test.p < _LEVEL]
    expected = np.array(robot.parameters)
    inertial = np.array([parameter.unit in _INERTIAL_UNITS for parameter in parameters])
    scale = ForceScale.of(values, std, expected, judged & inertial)
    smallest = min((test.p for test in tests), default=1.0)
    if scale is not None and (doubts or scale.p < _LEVEL):
        about = f"about {scale.factor:.2g}"
        seen = f"the inertial parameters are {about} times the expected ones"
        pairs = zip(parameters, scale.alike, strict=True)
        finding = FORCE_SCALE.fails(
            "; ".join([seen, *(doubt.sentence for doubt in doubts[:_MOST_SHOWN])]),
            min(smallest, scale.p),
            _LEVEL,
            f"{about}: {join_words(parameter.name for parameter, alike in pairs if alike)}",
            advise_on_scale(scale.factor, robot.description.drive.torque_per_force, far=scale.far),
        )
        # Another machine of the kind may have all bodies heavier, unless its forces are known.
        deviations = () if estimate.systematic is None else estimate.systematic.deviations
        stated = any(one.group == _COMMON_FACTOR for one in deviations)
        return replace(finding, serious=bool(doubts) or scale.far or stated)
    if not doubts:
        return _PLAUSIBLE.holds(
            "masses, moments of inertia and friction are physically consistent, and the inertial "
            "parameters have the expected size",
            smallest,
            _LEVEL,
        )
    # The mass is the most informative parameter.
    doubts.sort(key=lambda doubt: doubt.where != MASS)
    shown, others = doubts[:_MOST_SHOWN], len(doubts) - _MOST_SHOWN
    more = f"{others} more" if others > 0 else ""
    sentences = [doubt.sentence for doubt in shown] + [f"and {more}"] * bool(more)
    where = join_words([*(doubt.where for doubt in shown), more])
    advice = _advise_on_terms(robot, {doubt.where for doubt in doubts})
    return _PLAUSIBLE.fails("; ".join(sentences), smallest, _LEVEL, where, advice)


def _advise_on_terms(robot: Robot, implausible: Collection[str]) -> str:
    """Return advice if all implausible parameters are those of terms that a user added."""
    added = [
        term for term in robot.terms if term.name not in DEFAULT and term.name != DRIVE_INERTIA.name
    ]
    if not set(implausible) <= {parameter.name for parameter in parameters_of(tuple(added))}:
        return ""
    terms = join_words(
        f"`{term.name}`"
        for term in added
        if any(parameter.name in implausible for parameter in term.parameters)
    )
    return (
        f"remove {terms} from the robot's `terms`: with impossible parameters it imitates another "
        "effect. Look for its cause in the residuals"
    )


def _check_parameters(
    robot: Robot,
    parameters: Sequence[Parameter],
    estimate: ParameterEstimate,
    judged: NDArray[np.bool_],
) -> Iterator[_Doubt]:
    """Yield the most doubtful gap of each single parameter."""
    mass, length = abs(robot.description.parameters.get(MASS, 0.0)), robot.characteristic_length
    for k in np.flatnonzero(judged).tolist():
        parameter, std = parameters[k], float(estimate.std[k])
        alike = [
            abs(value)
            for other, value in zip(parameters, robot.parameters, strict=True)
            if other.unit == parameter.unit
        ]
        size = max(mass * length ** _INERTIAL_UNITS.get(parameter.unit, 0), *alike)
        freedom = float(estimate.freedom[k])
        found = [
            _Doubt(parameter.name, sentence, float(scipy.stats.t.sf(gap / std, freedom)))
            for gap, sentence in _gaps(
                parameter, float(estimate.values[k]), std, robot.parameters[k], size
            )
        ]
        if found:
            yield next((one for one in found if one.p < _LEVEL), found[0])


def _gaps(
    parameter: Parameter, value: float, std: float, expected: float, size: float
) -> Iterator[tuple[float, str]]:
    """Yield the gaps between an estimate and plausible values, with an explanation."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    found = f"{parameter.name} = {value:.3g} ± {std:.1g}{unit}"
    # Small moments of inertia absorb errors of the model: only relevant gaps count.
    slack = MATTERS * size if _INERTIAL_UNITS.get(parameter.unit, 0) else 0.0
    if np.isfinite(parameter.lower):
        yield (
            parameter.lower - value - slack,
            f"{found} is negative" if parameter.lower == 0 else f"{found} is too small",
        )
    if np.isfinite(parameter.upper):
        yield (
            value - parameter.upper - slack,
            f"{found} is positive" if parameter.upper == 0 else f"{found} is too large",
        )
    if parameter.unit not in _INERTIAL_UNITS or expected == 0:
        return
    if abs(value - expected) <= MATTERS * size:
        return
    against = f"{found}, expected {expected:.3g}{unit}"
    yield abs(expected) / ORDER - abs(value), against
    yield abs(value) - ORDER * abs(expected), against
    if min(abs(value), abs(expected)) > MATTERS * size:
        yield -value * np.sign(expected), against


def _check_lumps(
    robot: Robot,
    parameters: Sequence[Parameter],
    estimate: ParameterEstimate,
    alone: set[str],
) -> Iterator[_Doubt]:
    """Yield inconsistent lumps, except those with parameters that are implausible alone."""
    names = tuple(parameter.name for parameter in parameters)
    for lump in (lump for term in robot.terms for lump in term.lumps):
        if not set(lump.parameters) <= set(names) - alone:
            continue
        places = np.array([names.index(name) for name in lump.parameters])
        doubt = _lump(lump, places, robot, estimate)
        if doubt is not None:
            yield doubt


def _lump(
    lump: Lump, places: NDArray[np.intp], robot: Robot, estimate: ParameterEstimate
) -> _Doubt | None:
    """Test the matrix M of a lump along its smallest eigenvector v; None if M is positive.

    vᵀ M v is linear in the parameters. Since v depends on the estimate, the bound covers all
    combinations of the parameters (Scheffé).
    """
    scales = dict(zip(lump.parameters, robot.scales[places], strict=True))
    sizes = np.sqrt(np.abs(np.diag(lump.matrix(scales))))
    sizes = np.where(sizes > 0, sizes, 1.0)
    values = estimate.values[places]
    whole = lump.matrix(dict(zip(lump.parameters, values, strict=True)))
    least, directions = np.linalg.eigh(whole / np.multiply.outer(sizes, sizes))
    if least[0] >= 0:
        return None
    along = directions[:, 0] / sizes
    slope = np.array(
        [
            along @ lump.matrix(dict(zip(lump.parameters, unit, strict=True))) @ along
            for unit in np.eye(len(places))
        ]
    )
    variance = float(slope @ estimate.covariance[np.ix_(places, places)] @ slope)
    if not variance > 0 or not np.isfinite(variance):
        return None
    free = np.diag(estimate.covariance)[places] > 0
    freedom = float(np.min(estimate.freedom[places][free]))
    sigmas = -float(slope @ values) / np.sqrt(variance)
    p = float(scipy.stats.t.sf(sigmas, freedom))
    if len(whole) > 1:
        rank = np.count_nonzero(free)
        # F with infinite freedom of the denominator is chi-square.
        distribution = (
            scipy.stats.chi2(rank)
            if np.isinf(freedom)
            else scipy.stats.f(rank, freedom, scale=rank)
        )
        p = float(distribution.sf(sigmas**2))
    first, last = lump.parameters[0], lump.parameters[-1]
    which = (
        f"{first} … {last}" if len(lump.parameters) > _MOST_SHOWN else join_words(lump.parameters)
    )
    return _Doubt(which, f"{lump.meaning} are physically inconsistent ({which} together)", p)


@dataclass(frozen=True, eq=False)
class ForceScale:
    """Common factor between estimated and expected inertial parameters."""

    factor: float
    far: bool
    """No other machine of the kind differs by as much: a wrong sign, or another unit."""
    alike: NDArray[np.bool_]
    """(m,), parameters that differ by this factor."""
    p: float
    """p of the difference under noise, for the least certain of these."""

    @classmethod
    def of(
        cls, values: Array, std: Array, expected: Array, judged: NDArray[np.bool_]
    ) -> Self | None:
        """Find the common factor of most precise parameters, (m,) each; None if there is none.

        `judged` are the estimated inertial parameters. A factor is far if it is negative, at least
        nine, at most a ninth, or that between newtons and another unit. Any other one must be
        common to nearly all bodies.
        """
        known = judged & (expected != 0) & (std < _KNOWN_WELL * np.abs(values))
        ratios = np.divide(values, expected, out=np.full(len(values), np.nan), where=known)
        factor = float(np.median(ratios[known])) if np.any(known) else 1.0
        size, far = abs(factor), is_far(factor)
        if not far and 1 / _NEARBY <= size <= _NEARBY:
            return None
        spread, most, fewest = (_ALIKE, _MOST, _FEWEST) if far else _OF_NEARBY
        alike = known & (np.abs(ratios - factor) <= spread * size)
        if np.count_nonzero(alike) < max(fewest, most * np.count_nonzero(known)):
            return None
        gaps = np.abs(values - expected)[alike] / std[alike]
        p = float(scipy.stats.norm.sf(np.min(gaps)))
        return cls(factor, far, alike, p)


def is_far(factor: float) -> bool:
    """Return whether no other machine of the kind has forces that differ by such a factor."""
    size = abs(factor)
    return factor < 0 or not 1 / _FAR < size < _FAR or _unit_of(size)[0] is not None


def advise_on_scale(factor: float, torque_per_force: float | None, *, far: bool = True) -> str:
    """Return probable causes of a common factor of all forces, with the keys to change."""
    size, words = abs(factor), []
    if factor < 0:
        words.append(
            "the sign of all forces is wrong (forces are positive when they extend the strut: "
            "`data.sign: {Q: -1}`, or a negative `data.force_constants`), or gravity and the z "
            "axis point the other way"
        )
    words += (each.sentence for each in _misread_units(size, torque_per_force))
    if size <= 1 / _FAR:
        words.append(
            "currents were read as newtons (`data.units: {Q: A}` with `data.force_constants` "
            f"of about {float(f'{1 / size:.2g}'):g} N/A), or the given force constants are "
            "too small by that factor"
        )
    elif not far:
        words.append(
            "check the force constants and the unit of the forces (`data.force_constants`, "
            "`data.units`; peak or effective currents, gear, lead), or correct the a-priori "
            "masses of the robot file"
        )
    elif size >= _FAR and _unit_of(size)[0] is None:
        words.append(
            "the force constants (`data.force_constants`) are too large by about that factor"
        )
    return "; or ".join(words)


class MisreadUnit(NamedTuple):
    """Unit of values that were read as another."""

    unit: str
    gain: float
    """Factor that corrects the values that were read."""
    sentence: str


def misread_unit(factor: float, torque_per_force: float | None) -> MisreadUnit | None:
    """Return the unit of the forces by a factor that no machine has.

    None: no unit has the factor, several have it, or the forces of another machine could.
    """
    found = list(_misread_units(factor, torque_per_force)) if factor > 0 else []
    return found[0] if len(found) == 1 and not 1 / _FAR < factor < _FAR else None


def _misread_units(factor: float, torque_per_force: float | None) -> Iterator[MisreadUnit]:
    """Yield units whose values were read as others, by the factor of all forces."""
    turn = 0.0 if torque_per_force is None else float(np.log(torque_per_force))
    if turn and abs(np.log(factor) - turn) < _NEAR:
        text = "torques in N m were read as newtons (`data.units: {Q: N m}`)"
        yield MisreadUnit("N m", np.exp(-turn), text)
    elif turn and abs(np.log(factor) + turn) < _NEAR:
        text = "forces in newtons were read as torques (`data.units: {Q: N}`)"
        yield MisreadUnit("N", np.exp(turn), text)
    unit, gain = _unit_of(factor)
    if unit == FORCE.unit:
        text = "the forces are in newtons, and `data.units` says another unit"
        yield MisreadUnit(unit, gain, text)
    elif unit is not None:
        key = f"`data.units: {{Q: {unit}}}`"
        text = f"the forces are in another unit, by the factor in {unit} ({key})"
        yield MisreadUnit(unit, gain, text)


def _unit_of(factor: float) -> tuple[str | None, float]:
    """Return the unit of values that were read as newtons, by the factor of all parameters.

    With the factor that corrects them. The unit is newtons if values in newtons were read as
    another unit.
    """
    if 1 / _LARGE < factor < _LARGE:
        return None, 1.0
    sizes = {unit: FORCE.parse(f"1 {unit}") for unit in FORCE.units}
    near = {unit: abs(np.log(factor * size)) for unit, size in sizes.items()}
    unit = min(near, key=near.__getitem__)
    if near[unit] < _NEAR:
        return unit, sizes[unit]
    swapped = min(sizes.values(), key=lambda size: abs(np.log(factor / size)))
    return (FORCE.unit, 1 / swapped) if abs(np.log(factor / swapped)) < _NEAR else (None, 1.0)
