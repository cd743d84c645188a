"""Results of one estimator: parameters, systematic errors, physical consistency, payload.

Each part is stored under the estimator in `estimate.json`, and as rows of a table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.estimators.result import (
    ABOUT_CENTRE,
    SEEN,
    TEN,
    EstimateUncertainty,
    ParameterEstimate,
    PayloadEstimate,
)
from estimation.uncertainty.consistency import ConsistentEstimate
from estimation.uncertainty.intervals import interval_widths
from expdesign.information.identifiable import KnownCombination
from expdesign.mechanism.bodies import about_centre
from expdesign.mechanism.terms import parameter_unit
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import Robot
from expdesign.robot.derived import ErrorShares, KnownQuantity, derived_quantities, known_quantities
from expdesign.runfolder import Numbers, OpenNumber, described
from expdesign.trajectory import FourierKeys


@dataclass(frozen=True)
class BudgetRow:
    """Share of one group of tolerances in the variance of one parameter."""

    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of std")]
    source: Annotated[str, described("", "key of the tolerance; noise: the random share")]
    std: Annotated[float, described("see unit", "standard deviation that it makes")]
    share_percent: Annotated[float, described("%", "its share of the total variance")]


@dataclass(frozen=True)
class DeviationRow:
    """Tolerance and estimate of one deviation."""

    deviation: Annotated[str, described("", "name, such as base_joint_1_x")]
    source: Annotated[str, described("", "key of its tolerance")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    tolerance: Annotated[
        OpenNumber,
        described("see unit", "standard deviation in the robot file; empty: nothing was known"),
    ]
    value: Annotated[float, described("see unit", "estimate; zero where it is not estimated")]
    std: Annotated[float, described("see unit", "its standard deviation")]
    ratio: Annotated[
        OpenNumber, described("1", "std over tolerance: 1 if the data say nothing; empty without")
    ]
    z: Annotated[
        OpenNumber,
        described(
            "1",
            "value over its scatter in machines within their tolerances, √(tolerance² − std²); "
            "empty where the data say nothing",
        ),
    ]


def budget_rows(entry: EstimatorResult) -> Iterator[BudgetRow]:
    """Yield the shares of every free parameter; none without tolerances."""
    groups = {} if entry.systematic is None else entry.systematic.groups
    if not groups:
        return
    names, variance = list(entry.values), np.diag(entry.covariance)
    systematic = sum((std**2 for std in groups.values()), np.zeros(len(names)))
    noise = np.sqrt(np.maximum(variance - systematic, 0.0))
    for k in np.flatnonzero(variance > 0):
        for source, std in {"noise": noise, **groups}.items():
            share = 100 * float(std[k] ** 2 / variance[k])
            unit = parameter_unit(names[k])
            yield BudgetRow(names[k], unit, source, float(std[k]), share)


def deviation_rows(entry: EstimatorResult) -> Iterator[DeviationRow]:
    """Yield the tolerances and estimates of all deviations."""
    for one in () if entry.systematic is None else entry.systematic.deviations:
        toleranced = 0 < one.tolerance < np.inf
        ratio = one.std / one.tolerance if toleranced else np.nan
        seen = toleranced and one.scatter > SEEN * one.tolerance
        z = one.value / one.scatter if seen else np.nan
        numbers = one.tolerance, one.value, one.std, ratio, z
        yield DeviationRow(one.name, one.group, one.unit, *numbers)


@dataclass(frozen=True)
class ConsistentRow:
    """One parameter of an estimate and of the nearest physically consistent parameters."""

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


def consistent_rows(entry: EstimatorResult) -> Iterator[ConsistentRow]:
    """Yield the rows of all parameters; none without consistent ones."""
    if (result := entry.consistent) is None:
        return
    std = np.where(entry.std > 0, entry.std, np.nan).tolist()
    for k, (name, value) in enumerate(entry.values.items()):
        yield ConsistentRow(
            parameter=name,
            unit=parameter_unit(name),
            estimate=value,
            std=std[k],
            consistent=result.values[name],
            moved=float(result.moved[k]),
            ci_low=float(result.low[k]),
            ci_high=float(result.high[k]),
            spread=float(result.spread[k]),
        )


@dataclass(frozen=True, kw_only=True)
class ConstantResult:
    """Estimate of a constant of a term."""

    constant: Annotated[str, described("", "term and constant, such as cogging.pitch")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    value: Annotated[float, described("see unit", "estimate")]
    std: Annotated[float, described("see unit", "its standard deviation")]
    stated: Annotated[float, described("see unit", "value in the robot file: where it began")]
    tolerance: Annotated[
        OpenNumber, described("see unit", "prior standard deviation; empty: nothing was known")
    ]


@dataclass(frozen=True, kw_only=True)
class EstimatedQuantity(KnownQuantity):
    """A derived quantity with its 95 % interval."""

    ci_low: Annotated[OpenNumber, described("see unit", "lower end of the 95 % interval")]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end of the 95 % interval")]


def estimated_quantities(
    robot: Robot, found: ParameterEstimate, regrouping: Array | None
) -> Iterator[EstimatedQuantity]:
    """Yield the derived quantities of an estimate with its intervals.

    `regrouping`, (m, m), is the matrix from p to β for base parameters; None without these.
    """
    system, free = found.systematic, found.std > 0
    effects = np.zeros((len(found.values), 0)) if system is None else system.scaled_response
    sources = () if system is None else tuple(one.group for one in system.deviations)
    errors = ErrorShares(found.covariance_random, effects, sources)
    derived = derived_quantities(robot, found.values)
    widths = np.where(free, interval_widths(found.freedom), 0.0)
    # Functions of several parameters get the freedom of the least known one.
    least = np.max(np.where(derived.jacobian != 0, widths, 0.0), axis=1)
    width = dict(zip(derived.names, least.tolist(), strict=True))
    for one in known_quantities(derived, errors, robot.scales, regrouping):
        half = width[one.quantity] * one.std
        ends = {"ci_low": one.value - half, "ci_high": one.value + half}
        yield EstimatedQuantity(**asdict(one), **ends)


_SURE = 3.0
"""Smallest mass, in standard deviations, with a defined centre."""
_UNITS = tuple(parameter_unit(name) for name in OF_A_BODY.values())
_UNITS_ABOUT_CENTRE = ("m",) * 3 + _UNITS[4:]


@dataclass(frozen=True)
class PayloadRow:
    """One number of a payload by one estimator."""

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


def payload_rows(entry: EstimatorResult) -> Iterator[PayloadRow]:
    """Yield the ten parameters, then centre and inertia about it by the delta method."""
    if (result := entry.payload) is None:
        return
    values, covariance = result.vector, result.covariance
    systematic = result.covariance_systematic
    widths = interval_widths(result.freedom)
    yield from _rows(TEN, _UNITS, values, (covariance, systematic), widths)
    if values[0] > _SURE * np.sqrt(covariance[0, 0]):
        derived, slope = about_centre(values)
        shares = slope @ covariance @ slope.T, slope @ systematic @ slope.T
    else:
        derived = np.full(len(ABOUT_CENTRE), np.nan)
        shares = (np.full((len(derived),) * 2, np.nan),) * 2
    # Functions of several parameters get the freedom of the least known one.
    least = np.full(len(derived), np.max(widths))
    yield from _rows(ABOUT_CENTRE, _UNITS_ABOUT_CENTRE, derived, shares, least)


def _rows(
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
        yield PayloadRow(name, unit, *numbers)


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatorResult(EstimateUncertainty):
    """Estimates of one estimator with their uncertainty."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    covariance_systematic: Annotated[
        Numbers, described("SI", "its share that the robot's tolerances make")
    ]
    constants: Annotated[
        tuple[ConstantResult, ...],
        described("", "constants of terms that were estimated, as in tables/constants.csv"),
    ]
    derived: Annotated[
        tuple[EstimatedQuantity, ...],
        described("", "mass, centre, inertia and further quantities; of each the table's columns"),
    ] = ()
    payload: Annotated[
        PayloadEstimate | None,
        described("", "load in addition to the machine identified before; null: none"),
    ]
    consistent: Annotated[
        ConsistentEstimate | None,
        described("", "the nearest physically consistent parameters; null: excluded by fixed ones"),
    ]
    base_parameters: Annotated[
        tuple[KnownCombination, ...],
        described("", "combinations that the data identify; of each the table's columns"),
    ]
    inseparable: Annotated[
        tuple[KnownCombination, ...],
        described(
            "", "combinations that no motion separates, each estimated as its first parameter"
        ),
    ]
    motions: Annotated[
        tuple[FourierKeys, ...], described("", "motion of every recording, as in design.json")
    ]


@dataclass(frozen=True)
class PrecisionRow:
    """Shares of one standard deviation of one estimator, and the Cramér–Rao bound."""

    parameter: Annotated[str, described("", "name")]
    std: Annotated[float, described("SI", "standard deviation")]
    std_forces: Annotated[float, described("SI", "the share that the noise of the forces makes")]
    std_kinematics: Annotated[
        OpenNumber, described("SI", "the share that the noise of the lengths makes")
    ]
    bound: Annotated[
        OpenNumber, described("SI", "Cramér–Rao bound with noise in forces and lengths")
    ]
