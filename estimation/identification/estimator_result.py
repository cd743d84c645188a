"""What tolerances make of an estimate, as its run folder keeps it: the budget."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.estimators import SystematicUncertainty
from estimation.estimators.payload import ABOUT_CENTRE, TEN, PayloadEstimate, about_centre
from estimation.uncertainty.consistency import ConsistentEstimate
from estimation.uncertainty.intervals import interval_widths
from expdesign.information.identifiable import listed
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import Robot
from expdesign.robot.deviation import apply_deviations, estimated_constants
from expdesign.runfolder import Numbers, OpenNumber, OpenNumbers, copied, described


@dataclass(frozen=True, eq=False, kw_only=True)
class DeviationKeys:
    """One number that is not known exactly."""

    name: Annotated[str, described("", "what deviates, such as base_joint_1_x")]
    group: Annotated[str, described("", "key of its tolerance in the robot file")]
    unit: Annotated[str, described("", "SI unit of tolerance, value and std")]
    tolerance: Annotated[
        OpenNumber,
        described("see unit", "standard deviation in the robot file; null: nothing was known"),
    ]
    value: Annotated[float, described("see unit", "estimate; zero where it is not estimated")]
    std: Annotated[
        float, described("see unit", "its standard deviation; the tolerance where not estimated")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class SystematicKeys:
    """What the deviations of the machine do to an estimate."""

    estimated: Annotated[bool, described("", "they were estimated together with the parameters")]
    deviations: Annotated[tuple[DeviationKeys, ...], described("", "what is not known exactly")]
    response: Annotated[
        Numbers, described("SI", "what each parameter moves by per unit of each deviation, m × t")
    ]
    left: Annotated[
        Numbers | None,
        described("SI", "what each estimate of a deviation is off by per unit of each, t × t"),
    ] = None

    @classmethod
    def of(cls, systematic: SystematicUncertainty | None) -> Self | None:
        """Describe it."""
        if systematic is None:
            return None
        numbers = zip(
            systematic.deviations,
            systematic.values.tolist(),
            systematic.std.tolist(),
            strict=True,
        )
        found = tuple(
            copied(DeviationKeys, one, tolerance=one.std, value=value, std=std)
            for one, value, std in numbers
        )
        return copied(cls, systematic, deviations=found)

    @property
    def scaled_response(self) -> Array:
        """(m, t), what one standard deviation of each tolerance does to each parameter, SI.

        Zero of what was estimated without one.
        """
        tolerances = np.array([each.tolerance for each in self.deviations])
        return self.response * np.where(np.isfinite(tolerances), tolerances, 0.0)

    @property
    def with_priors(self) -> bool:
        """Whether something that has a tolerance was estimated."""
        return self.estimated and any(
            each.std != each.tolerance < np.inf for each in self.deviations
        )

    @property
    def groups(self) -> dict[str, Array]:
        """Standard deviation, (m,), SI, that each group of tolerances makes."""
        groups = np.array([each.group for each in self.deviations])
        known = [each.group for each in self.deviations if np.isfinite(each.tolerance)]
        return {
            group: np.linalg.norm(self.scaled_response[:, groups == group], axis=1)
            for group in dict.fromkeys(known)
        }


def shared_response(
    first: SystematicKeys | None, second: SystematicKeys | None
) -> tuple[Array, Array]:
    """Return what the deviations that two estimates share do to each of them.

    Entries of the same name with the same tolerance are one and the same number of a machine.

    Returns
    -------
    first, second : (m, t)
        What one standard deviation of each entry of both does; no columns where nothing is shared.
    """
    if first is None or second is None:
        return np.zeros((0, 0)), np.zeros((0, 0))
    places = [
        {(one.name, one.tolerance): place for place, one in enumerate(keys.deviations)}
        for keys in (first, second)
    ]
    common = [name for name in places[0] if name in places[1]]
    at_first, at_second = ([each[name] for name in common] for each in places)
    return first.scaled_response[:, at_first], second.scaled_response[:, at_second]


@dataclass(frozen=True)
class BudgetRow:
    """What one group of tolerances costs one parameter."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of std")]
    source: Annotated[
        str, described("", "key of the tolerance; noise: what another recording draws anew")
    ]
    std: Annotated[float, described("see unit", "standard deviation that it makes")]
    share_percent: Annotated[float, described("%", "its share of the total variance")]


@dataclass(frozen=True)
class DeviationRow:
    """What is known of one deviation."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    deviation: Annotated[str, described("", "what deviates, such as base_joint_1_x")]
    source: Annotated[str, described("", "key of its tolerance")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    tolerance: Annotated[
        OpenNumber,
        described("see unit", "standard deviation in the robot file; empty: nothing was known"),
    ]
    value: Annotated[float, described("see unit", "estimate; zero where it is not estimated")]
    std: Annotated[float, described("see unit", "its standard deviation")]


def budget_rows(
    estimator: str, names: tuple[str, ...], covariance: Array, keys: SystematicKeys
) -> Iterator[BudgetRow]:
    """Yield the shares of every free parameter; `covariance` is the total, (m, m)."""
    variance = np.diag(covariance)
    groups = keys.groups
    systematic = sum((std**2 for std in groups.values()), np.zeros(len(names)))
    noise = np.sqrt(np.maximum(variance - systematic, 0.0))
    for k in np.flatnonzero(variance > 0):
        for source, std in {"noise": noise, **groups}.items():
            share = 100 * float(std[k] ** 2 / variance[k])
            unit = parameter_unit(names[k])
            yield BudgetRow(estimator, names[k], unit, source, float(std[k]), share)


def deviation_rows(estimator: str, keys: SystematicKeys) -> Iterator[DeviationRow]:
    """Yield what is known of every deviation."""
    for one in keys.deviations:
        numbers = one.tolerance, one.value, one.std
        yield DeviationRow(estimator, one.name, one.group, one.unit, *numbers)


_RARE = 0.01
"""p value below which none is told: the test ends before it knows it."""
_FLOOR = 1e-3
"""Distance in σ below which none is told."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyKeys:
    """One body, in the frame of docs/model.md."""

    mass: Annotated[float, described("kg", "mass")]
    moment: Annotated[Numbers, described("kg m", "(3,) first moment about the frame's origin")]
    inertia: Annotated[
        Numbers, described("kg m^2", "3 × 3 about the frame's origin, products as matrix entries")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class ConsistentKeys:
    """The nearest parameters to an estimate that some set of bodies has."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    moved: Annotated[
        OpenNumbers,
        described("1", "(m,) values less estimate in σ, of base parameters by their combinations"),
    ]
    exchanged: Annotated[
        tuple[str, ...],
        described("", "held parameters that took other values: no force shows which they have"),
    ]
    distance: Annotated[
        float, described("1", "from the estimate, standard deviations; 0: bodies have it")
    ]
    p: Annotated[
        float, described("1", "how often noise makes that distance where bodies have the truth")
    ]
    significant: Annotated[bool, described("", "p is below 5 %")]
    active: Annotated[tuple[str, ...], described("", "conditions and bounds that it stands at")]
    spread: Annotated[
        OpenNumbers,
        described("SI", "(m,) root mean square error by simulation; null: fixed"),
    ]
    low: Annotated[OpenNumbers, described("SI", "(m,) lower ends of the 95 % intervals")]
    high: Annotated[OpenNumbers, described("SI", "(m,) upper ends")]
    bodies: Annotated[
        dict[str, BodyKeys],
        described("", "ring, stator, slider and platform that have the values: one of many sets"),
    ]
    text: Annotated[str, described("", "in words")]

    @classmethod
    def of(cls, found: ConsistentEstimate | None, robot: Robot) -> Self | None:
        """Describe it."""
        if found is None:
            return None
        return copied(
            cls,
            found,
            values=dict(zip(robot.parameter_names, found.values.tolist(), strict=True)),
            bodies={name: copied(BodyKeys, body) for name, body in vars(found.bodies).items()},
            text=consistency_in_words(
                found, known=robot.realisable.bodies(robot.parameters) is not None
            ),
        )


def consistency_in_words(found: ConsistentEstimate, *, known: bool) -> str:
    """Say whether some bodies have an estimate, and what it means if not.

    `known` tells whether some have the values of the robot file.
    """
    if found.exchanged:
        told, others = "combinations", f", with other values of {listed(found.exchanged)}"
    else:
        told, others = "parameters", ""
    if found.realisable:
        return f"physically consistent: some set of bodies has these {told}{others}"
    near = max(found.distance, _FLOOR)
    said = (
        f"not physically consistent: the nearest {told} that some set of bodies has{others} are "
        f"{near:.2g} σ away, at the limit of {', '.join(found.active)}; "
    )
    share = f"{100 * found.p:.3g} % at most" if found.p > _RARE else f"less than {100 * _RARE:g} %"
    chance = f"noise alone makes such a distance in {share} of the cases"
    if found.significant:
        doubt = "a reason to look for what the model lacks, or for a larger tolerance or noise"
        if not known:
            doubt += (
                ". No bodies have the values of the robot file either: an estimate of a twin that "
                "has them is rightly found so"
            )
        return f"{said}{chance}: {doubt}"
    return f"{said}{chance}: no reason for doubt"


@dataclass(frozen=True)
class ConsistentRow:
    """One parameter of an estimate beside the nearest that bodies have."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    estimate: Annotated[float, described("see unit", "estimate, without constraints")]
    std: Annotated[
        OpenNumber, described("see unit", "its standard deviation; empty for a fixed parameter")
    ]
    consistent: Annotated[
        float, described("see unit", "of the nearest parameters that some set of bodies has")
    ]
    moved: Annotated[
        OpenNumber,
        described("1", "consistent less estimate in σ, of a base parameter its combination's"),
    ]
    ci_low: Annotated[
        OpenNumber, described("see unit", "lower end of the 95 % interval about consistent")
    ]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end")]
    spread: Annotated[
        OpenNumber,
        described("see unit", "root mean square error of consistent, by simulation from there"),
    ]


def consistent_rows(
    estimator: str,
    values: dict[str, float],
    covariance: Array,
    keys: ConsistentKeys,
) -> Iterator[ConsistentRow]:
    """Yield the rows of all parameters; `covariance`, (m, m), is that of the estimate."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0, std, np.nan).tolist()
    for k, (name, value) in enumerate(values.items()):
        yield ConsistentRow(
            estimator=estimator,
            parameter=name,
            unit=parameter_unit(name),
            estimate=value,
            std=std[k],
            consistent=keys.values[name],
            moved=float(keys.moved[k]),
            ci_low=float(keys.low[k]),
            ci_high=float(keys.high[k]),
            spread=float(keys.spread[k]),
        )


@dataclass(frozen=True, kw_only=True)
class ConstantKeys:
    """A constant of a term, as one estimator found it."""

    constant: Annotated[str, described("", "term and constant, such as cogging.pitch")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    value: Annotated[float, described("see unit", "estimate")]
    std: Annotated[float, described("see unit", "its standard deviation")]
    stated: Annotated[float, described("see unit", "value in the robot file: where it began")]
    tolerance: Annotated[
        OpenNumber, described("see unit", "prior standard deviation; empty: nothing was known")
    ]


@dataclass(frozen=True, kw_only=True)
class OfEstimator:
    """A row that is about one estimator."""

    estimator: Annotated[str, described("", "ls, gm or ml")]


@dataclass(frozen=True, kw_only=True)
class ConstantRow(ConstantKeys, OfEstimator):
    """A row of `tables/constants.csv`."""


def constants_found(
    robot: Robot, systematic: SystematicUncertainty | None
) -> tuple[ConstantKeys, ...]:
    """Return the constants that were estimated, of the robot as its file states it."""
    flagged = {one.name: one for one in estimated_constants(robot)}
    if systematic is None or not flagged:
        return ()
    moved = apply_deviations(robot, systematic.deviations, systematic.values)
    places = [one.name for one in systematic.deviations]
    return tuple(
        ConstantKeys(
            constant=flagged[name].group.partition(".")[2],
            unit=flagged[name].unit,
            value=found,
            std=float(systematic.std[places.index(name)]),
            stated=stated,
            tolerance=flagged[name].std if np.isfinite(flagged[name].std) else np.nan,
        )
        for name, stated, found in _named(robot, moved)
        if name in flagged and name in places
    )


def _named(robot: Robot, moved: Robot) -> Iterator[tuple[str, float, float]]:
    """Yield every constant's entry of θ, with its values before and after."""
    names = (f"{term.name}_{one.name}" for term in robot.terms for one in term.constants)
    values = robot.description.constants, moved.description.constants
    yield from zip(names, *values, strict=True)


def constant_rows(estimator: str, found: tuple[ConstantKeys, ...]) -> Iterator[ConstantRow]:
    """Yield the rows of one estimator."""
    yield from (copied(ConstantRow, one, estimator=estimator) for one in found)


_SURE = 3.0
"""Standard deviations that a mass has to be above zero, for its centre to be somewhere."""
_UNITS = tuple(parameter_unit(name) for name in OF_A_BODY.values())
_UNITS_ABOUT_CENTRE = ("m",) * 3 + _UNITS[4:]


@dataclass(frozen=True, eq=False, kw_only=True)
class PayloadKeys:
    """The ten parameters of a payload: mass, sx … sz, Ixx … Iyz about the TCP, platform frame."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    covariance: Annotated[
        Numbers,
        described("SI", "10 × 10, of the new recordings and of the identification before"),
    ]
    covariance_systematic: Annotated[
        Numbers, described("SI", "its share that the robot's tolerances make, 10 × 10")
    ]
    freedom: Annotated[
        OpenNumbers,
        described("1", "(10,) degrees of freedom behind the standard deviations; null: endless"),
    ]

    @classmethod
    def of(cls, payload: PayloadEstimate | None) -> Self | None:
        """Describe an estimate."""
        if payload is None:
            return None
        return copied(
            cls,
            payload,
            values=dict(zip(TEN, payload.values.tolist(), strict=True)),
            freedom=np.where(np.isinf(payload.freedom), np.nan, payload.freedom),
        )


@dataclass(frozen=True)
class PayloadRow:
    """One number of a payload by one estimator."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    quantity: Annotated[
        str,
        described(
            "",
            "mass; sx, sy, sz: first moments; Ixx … Iyz: inertia about the TCP; cx, cy, cz: centre "
            "of mass; Ixx_centre … Iyz_centre: inertia about it; all in the platform frame, "
            "products as matrix entries",
        ),
    ]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    value: Annotated[
        OpenNumber,
        described("see unit", "estimate; no centre is given of a mass that may be zero"),
    ]
    std: Annotated[
        OpenNumber,
        described("see unit", "standard deviation, of the identification before counted in"),
    ]
    std_random: Annotated[
        OpenNumber, described("see unit", "share of std that noise makes, now and before")
    ]
    std_systematic: Annotated[
        OpenNumber, described("see unit", "share of std that the robot's tolerances make")
    ]
    ci_low: Annotated[OpenNumber, described("see unit", "lower end of the 95 % interval")]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end of the 95 % interval")]


def payload_rows(estimator: str, keys: PayloadKeys) -> Iterator[PayloadRow]:
    """Yield the ten parameters, then centre and inertia about it by the delta method."""
    values = np.array([keys.values[name] for name in TEN])
    covariance, systematic = keys.covariance, keys.covariance_systematic
    widths = interval_widths(np.where(np.isnan(keys.freedom), np.inf, keys.freedom))
    yield from _rows(estimator, TEN, _UNITS, values, (covariance, systematic), widths)
    if values[0] > _SURE * np.sqrt(covariance[0, 0]):
        derived, slope = about_centre(values)
        shares = slope @ covariance @ slope.T, slope @ systematic @ slope.T
    else:
        derived = np.full(len(ABOUT_CENTRE), np.nan)
        shares = (np.full((len(derived),) * 2, np.nan),) * 2
    # Of what is made of several parameters there is as much behind as behind the least known.
    least = np.full(len(derived), np.max(widths))
    yield from _rows(estimator, ABOUT_CENTRE, _UNITS_ABOUT_CENTRE, derived, shares, least)


def _rows(
    estimator: str,
    names: tuple[str, ...],
    units: tuple[str, ...],
    values: Array,
    shares: tuple[Array, Array],
    widths: Array,
) -> Iterator[PayloadRow]:
    total, systematic = (np.diag(share) for share in shares)
    std = np.sqrt(total)
    columns = (
        values,
        std,
        np.sqrt(np.maximum(total - systematic, 0.0)),
        np.sqrt(np.maximum(systematic, 0.0)),
        values - widths * std,
        values + widths * std,
    )
    for name, unit, *numbers in zip(names, units, *(c.tolist() for c in columns), strict=True):
        yield PayloadRow(estimator, name, unit, *numbers)
