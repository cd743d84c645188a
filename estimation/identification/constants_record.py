"""Constants of terms that were estimated, as a run folder keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from estimation.estimators import Systematic
from expdesign.robot import Robot
from expdesign.robot.deviation import deviated, estimated_constants
from expdesign.runfolder import OpenNumber, copied, described


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


def constants_found(robot: Robot, systematic: Systematic | None) -> tuple[ConstantKeys, ...]:
    """Return the constants that were estimated, of the robot as its file states it."""
    flagged = {one.name: one for one in estimated_constants(robot)}
    if systematic is None or not flagged:
        return ()
    moved = deviated(robot, systematic.deviations, systematic.values)
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
