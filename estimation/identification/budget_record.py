"""What tolerances make of an estimate, as its run folder keeps it: the budget."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.estimators import Systematic
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder import Numbers, OpenNumber, copied, described


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
    def of(cls, systematic: Systematic | None) -> Self | None:
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
    def scaled(self) -> Array:
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
            group: np.linalg.norm(self.scaled[:, groups == group], axis=1)
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
    return first.scaled[:, at_first], second.scaled[:, at_second]


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
