"""Whether estimates are what a machine can have, and of the size that was expected.

Whether all bodies are wrong by one factor: forces of another unit, or of the other sign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

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
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot

ORDER = 10.0
"""Factor between an estimate and what was expected from which it is not plausible."""
MATTERS = 0.1
"""Share of what the robot's mass and length make, and of the largest of its kind, below which a
difference is no reason for doubt: nobody knows small parameters of bodies to an order of magnitude,
and every fault of a model shows in them first."""
SIGMAS = 3.0

_OF_BODIES = {"kg": 0, "kg m": 1, "kg m^2": 2}
"""Unit → power of the length."""
_LEVEL = float(ndtr(-SIGMAS))
_TOLD = 4

_PLAUSIBLE = Assumption(
    "the estimates are what a machine can have",
    "the estimates are not those of such a machine",
    "look for a force with the wrong sign (`data.sign`), forces or lengths in another unit "
    "(`data.units`, `data.force_constants`), channels in another order than the struts "
    "(`data.order`), a wrong zero of a length (`data.offset`), gravity that points the other "
    "way, the inertia of motors and screws (`drive`), and a-priori values of another machine",
)


@dataclass(frozen=True)
class _Doubt:
    """What is not plausible, why in words, and by how much the noise speaks."""

    where: str
    sentence: str
    p: float


def plausibility(robot: Robot, priors: ParameterPriors, estimate: ParameterEstimate) -> Finding:
    """Hold estimates against what bodies and friction can be, and against the a-priori values.

    What noise and tolerances may make, 3 σ, is left out. Not plausible are

    - less or more than any machine has: a negative mass or friction, or a negative moment of
      inertia where that matters;
    - masses, first moments and moments of inertia that no bodies of positive density have
      together: a pseudo-inertia (`Lump`) that is not positive semidefinite;
    - parameters of bodies that differ from the a-priori value by a factor of ten, or in sign, where
      the difference matters beside the robot's mass and length, and the largest of its kind;
    - parameters of bodies that all differ by one factor, which is ten or that of a unit.

    Friction and springs may be of any size.
    """
    parameters = parameters_of(robot.terms)
    count = len(parameters)
    values, std = estimate.values[:count], estimate.std[:count]
    judged = priors.free[:count] & (std > 0) & np.isfinite(std)
    tests = [*_single(robot, parameters, estimate, judged)]
    alone = {test.where for test in tests if test.p < _LEVEL}
    # A fixed value is the user's, whatever it is.
    alone |= {
        parameter.name
        for parameter, value, free in zip(parameters, values, judged, strict=True)
        if not free and not parameter.lower <= value <= parameter.upper
    }
    tests += _lumped(robot, parameters, estimate, alone)
    doubts = [test for test in tests if test.p < _LEVEL]
    expected = np.array(robot.parameters)
    of_bodies = np.array([parameter.unit in _OF_BODIES for parameter in parameters])
    scale = ForceScale.of(values, std, expected, judged & of_bodies)
    advice = "" if scale is None else scale.advice
    if scale is not None and not doubts:
        doubts = [_Doubt(scale.where(tuple(p.name for p in parameters)), scale.sentence, scale.p)]
        doubts = [doubt for doubt in doubts if doubt.p < _LEVEL]
    smallest = min((test.p for test in (*tests, *doubts)), default=1.0)
    if not doubts:
        return _PLAUSIBLE.holds(
            "masses, moments of inertia and friction are such as bodies can have, and bodies are "
            "of the size that was expected",
            smallest,
            _LEVEL,
        )
    # The mass tells most of what is wrong.
    doubts.sort(key=lambda doubt: doubt.where != MASS)
    names = [doubt.where for doubt in doubts]
    told = "; ".join(doubt.sentence for doubt in doubts[:_TOLD])
    more = f"; and {len(doubts) - _TOLD} more" if len(doubts) > _TOLD else ""
    where = join_words(
        names if len(names) <= _TOLD else [*names[:_TOLD], f"{len(names) - _TOLD} more"]
    )
    return _PLAUSIBLE.fails(f"{told}{more}", smallest, _LEVEL, where, advice)


def _single(
    robot: Robot,
    parameters: Sequence[Parameter],
    estimate: ParameterEstimate,
    judged: NDArray[np.bool_],
) -> Iterator[_Doubt]:
    """Yield the most doubtful of each parameter by itself, with the p of its gap."""
    mass, length = abs(robot.description.parameters.get(MASS, 0.0)), robot.characteristic_length
    for k in np.flatnonzero(judged).tolist():
        parameter, std = parameters[k], float(estimate.std[k])
        alike = [
            abs(value)
            for other, value in zip(parameters, robot.parameters, strict=True)
            if other.unit == parameter.unit
        ]
        size = max(mass * length ** _OF_BODIES.get(parameter.unit, 0), *alike)
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
    """Yield by how much an estimate is beyond what is plausible, with words for it."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    found = f"{parameter.name} = {value:.3g} ± {std:.1g}{unit}"
    # A small moment of inertia takes what the model lacks: only where it matters it is none.
    slack = MATTERS * size if _OF_BODIES.get(parameter.unit, 0) else 0.0
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
    if parameter.unit not in _OF_BODIES or expected == 0:
        return
    if abs(value - expected) <= MATTERS * size:
        return
    against = f"{found} where {expected:.3g}{unit} was expected"
    yield abs(expected) / ORDER - abs(value), against
    yield abs(value) - ORDER * abs(expected), against
    if min(abs(value), abs(expected)) > MATTERS * size:
        yield -value * np.sign(expected), against


def _lumped(
    robot: Robot,
    parameters: Sequence[Parameter],
    estimate: ParameterEstimate,
    alone: set[str],
) -> Iterator[_Doubt]:
    """Yield what no bodies have together, but of parameters that stand out alone."""
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
    """Judge the matrix of a lump along the direction in which it is least; None: it is positive.

    vᵀ M v is linear in the parameters. v is taken from them, so the bound is that over all
    combinations of them (Scheffé).
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
        # F with endless freedom below is chi-square.
        law = (
            scipy.stats.chi2(rank)
            if np.isinf(freedom)
            else scipy.stats.f(rank, freedom, scale=rank)
        )
        p = float(law.sf(sigmas**2))
    first, last = lump.parameters[0], lump.parameters[-1]
    which = f"{first} … {last}" if len(lump.parameters) > _TOLD else join_words(lump.parameters)
    return _Doubt(which, f"no bodies have {lump.meaning} ({which} together)", p)


_FAR = 9.0
"""Factor from which it is no other machine of the kind; kilograms in place of newtons make 9.8."""
_NEAR = 0.15
"""How well a factor must be that of a unit: masses are known that well."""
_LARGE = 2.5
_KNOWN_WELL = 0.1
_ALIKE = 0.3
_MOST = 2 / 3
_FEWEST = 2


@dataclass(frozen=True, eq=False)
class ForceScale:
    """The factor between estimated parameters of bodies and those expected."""

    factor: float
    alike: NDArray[np.bool_]
    """(m,), the parameters that differ by it."""
    p: float
    """That noise makes the difference in the least certain of these."""

    @classmethod
    def of(
        cls, values: Array, std: Array, expected: Array, judged: NDArray[np.bool_]
    ) -> Self | None:
        """Return the factor of most parameters that are known well, (m,) each; None without one.

        `judged` are the parameters of bodies that were estimated. A factor counts when it is
        negative, nine or more, a ninth or less, or that between newtons and another unit.
        """
        known = judged & (expected != 0) & (std < _KNOWN_WELL * np.abs(values))
        if np.count_nonzero(known) < _FEWEST:
            return None
        ratios = np.divide(values, expected, out=np.full(len(values), np.nan), where=known)
        factor = float(np.nanmedian(ratios))
        alike = known & (np.abs(ratios - factor) <= _ALIKE * abs(factor))
        if np.count_nonzero(alike) < max(_FEWEST, _MOST * np.count_nonzero(known)):
            return None
        size = abs(factor)
        far = size <= 1 / _FAR or size >= _FAR
        if factor > 0 and not far and _unit_of(size) is None:
            return None
        gaps = np.abs(values - expected)[alike] / std[alike]
        return cls(factor, alike, float(scipy.stats.norm.sf(np.min(gaps))))

    def where(self, names: tuple[str, ...]) -> str:
        """Return the parameters in words."""
        return join_words([name for name, one in zip(names, self.alike, strict=True) if one])

    @property
    def sentence(self) -> str:
        """What was seen."""
        return f"the bodies' parameters are about {self.factor:.2g} times what was expected"

    @property
    def advice(self) -> str:
        """What makes that, and what to write."""
        size, words = abs(self.factor), []
        if self.factor < 0:
            words.append(
                "the sign of all forces is wrong (forces are positive when they extend the strut: "
                "`data.sign: {Q: -1}`, or a negative `data.force_constants`), or gravity and the z "
                "axis point the other way"
            )
        unit = _unit_of(size)
        if unit is not None:
            words.append(
                f"the forces are in another unit, by the factor in {unit} (`data.units: {{Q: "
                f"{unit}}}`)"
                if unit != FORCE.unit
                else "the forces are in newtons, and `data.units` says another unit"
            )
        if size <= 1 / _FAR:
            words.append(
                "currents were taken for newtons (`data.units: {Q: A}` with `data.force_constants` "
                f"of about {float(f'{1 / size:.2g}'):g} N/A), or the force constants that are "
                "given are too small by that factor"
            )
        elif size >= _FAR and unit is None:
            words.append(
                "the force constants (`data.force_constants`) are too large by about that factor"
            )
        return f"{self.sentence}: {'; or '.join(words)}"


def _unit_of(factor: float) -> str | None:
    """Return the unit whose numbers were taken for newtons, by what that makes of all parameters.

    Newtons themselves: numbers in newtons were taken for those of another unit.
    """
    if 1 / _LARGE < factor < _LARGE:
        return None
    sizes = {unit: FORCE.parse(f"1 {unit}") for unit in FORCE.units}
    near = {unit: abs(np.log(factor * size)) for unit, size in sizes.items()}
    unit = min(near, key=near.__getitem__)
    if near[unit] < _NEAR:
        return unit
    swapped = min(abs(np.log(factor / size)) for size in sizes.values())
    return FORCE.unit if swapped < _NEAR else None
