"""Candidate causes of residuals, and their t-tests: forces along columns that the model lacks.

A family of causes is data: columns with their names, a level, and words. The regressor's own
columns tell which parameter is wrong, and where. Held-out data: every column, over all actuators.
Data that were fitted have no score on the columns of the estimated parameters; there, each column
is tested in one actuator at a time, which finds a parameter that is not the same in all struts,
and the whole columns of parameters that were fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_serializer
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.channel_test import COLUMNS, DELAY, Strut
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.tails import log_two_sided
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumber, described

POWER = 0.8
"""Of the test, for which the smallest error that is found is stated."""
_SEEN = 1e-6
"""Share of a column's information that the model's own columns must leave."""

Label = tuple[str, int | None]
"""Parameter, or empty, and actuator (from 0; None: all of them)."""


@dataclass(frozen=True, eq=False)
class Cause:
    """A family of candidate causes that are tested alike and named in the same words."""

    kind: str
    """Of the effects that are found."""
    labels: tuple[Label, ...]
    columns: Array
    """(R, 6, q), N per unit of the effect."""
    level: float
    assumption: Assumption
    """That there is no such effect."""
    words: str
    """What such an effect is, in the advice on a bias."""
    present: str
    absent: str
    """The sentences when effects were found and when none was; the latter is a format of `p`,
    `value` and `std` of the most significant column."""
    untested: str
    """Why there is no test when no column is left."""
    scale: float = 1.0
    """From SI to the unit shown."""
    number: str = "+.3g"
    """Format of a value."""
    unit: Callable[[str], str] = parameter_unit
    """From the parameter to the unit shown."""


@dataclass(frozen=True)
class ColumnResult:
    """t-test of the residuals on one column."""

    parameter: Annotated[str, described("", "whose column it is")]
    actuator: Annotated[Strut, described("1", "number of the actuator; null: all of them")]
    t: Annotated[OpenNumber, described("1", "null where the model leaves nothing to test")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of the two-sided p of this test")]
    coefficient: Annotated[OpenNumber, described("SI", "change of the parameter that is asked for")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the coefficient")]
    detectable: Annotated[OpenNumber, described("SI", "smallest error that is found with `power`")]
    failed: Annotated[bool, described("", "residuals lie along the column")]


@dataclass(frozen=True)
class ColumnTest:
    """t-tests of all columns of a family."""

    power: Annotated[float, described("1", "of the test")]
    family_level: Annotated[float, described("1", "level of all columns together")]
    tested: Annotated[int, described("1", "number of columns that leave something to test")]
    columns: Annotated[tuple[ColumnResult, ...], described("", "one by one")]

    @property
    def best(self) -> int:
        """Place of the most significant column."""
        return int(np.nanargmin([column.log_p for column in self.columns]))


def causes(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool, experiments: int = 1
) -> tuple[Cause, ...]:
    """Return the families that are tested; each of several experiments gets its share of a level.

    `names` are those of the regressor's columns; when `held_out`, the parameters were not estimated
    from these data.
    """
    parameters = Assumption(
        "one value fits all struts",
        "a parameter is not the same in all struts, or was fixed at a wrong value",
        "free what was fixed, or look for a fault in the struts named; the model has one value "
        "for all struts",
    )
    if held_out:
        parameters = Assumption(
            "the parameters are right",
            "parameters are wrong",
            "check these parameters against the machine, or identify them on a motion like this "
            "one",
        )
    labels, columns = _parameter_columns(part, names, held_out=held_out)
    delays = part.delay_column.shape[2]
    return (
        Cause(
            kind="column",
            labels=labels,
            columns=columns,
            level=COLUMNS / experiments,
            assumption=parameters,
            words="an error along the regressor's columns",
            present="the residuals ask for a change of",
            absent="nothing of the residuals lies along the regressor's columns (p = {p:.2g})",
            untested="no column of the regressor is left to test",
        ),
        Cause(
            kind="delay",
            labels=(("", None),) * delays,
            columns=part.delay_column,
            level=DELAY / experiments,
            assumption=Assumption(
                "forces and lengths are sampled at the same time",
                "the forces lag behind the lengths",
                "give the delay in `data.delay` and estimate again",
            ),
            words="a delay between the channels",
            present="the forces lag behind the lengths",
            absent="the forces lag by {value:.3g} ± {std:.1g} ms",
            untested="the forces do not change in time"
            if delays
            else "pointwise kinematics give no derivative of the forces in time",
            scale=1e3,
            number=".3g",
            unit=lambda _: "ms",
        ),
    )


def _parameter_columns(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool
) -> tuple[tuple[Label, ...], Array]:
    labels: list[Label] = []
    columns = []
    for k, name in enumerate(names):
        whole = part.regressors[:, :, k]
        touched = np.flatnonzero(np.any(whole != 0, axis=0))
        if held_out or not part.free[k]:
            labels.append((name, None))
            columns.append(whole)
        if held_out or len(touched) < 2:  # noqa: PLR2004 - a part of one actuator is the whole
            continue
        for strut in touched:
            labels.append((name, int(strut)))
            columns.append(np.where(np.arange(ACTUATORS) == strut, whole, 0.0))
    stacked = np.stack(columns, axis=2) if columns else np.zeros((*part.forces.shape, 0))
    return tuple(labels), stacked


def column_test(solved: SolvedSystem, cause: Cause) -> ColumnTest:
    """Test each column by itself."""
    score, information, whole = solved.scores(cause.columns)
    seen = information > _SEEN * np.where(whole > 0, whole, np.inf)
    information = np.where(seen, information, np.nan)
    std = 1 / np.sqrt(information)
    statistic = score / np.sqrt(information)
    log_p = log_two_sided(statistic, solved.system.freedom)
    tested = int(np.count_nonzero(seen))
    level = cause.level / max(tested, 1)
    detectable = std * (stats.norm.isf(level / 2) + stats.norm.ppf(POWER))
    numbers = np.stack([statistic, log_p, score / information, std, detectable]).tolist()
    rows = zip(*numbers, (log_p < np.log(level)).tolist(), strict=True)
    columns = (ColumnResult(*label, *row) for label, row in zip(cause.labels, rows, strict=True))
    return ColumnTest(POWER, cause.level, tested, tuple(columns))


@dataclass(frozen=True)
class DelayTest:
    """By how much the forces lag behind the lengths, beyond the delays that were given."""

    refused: Annotated[str, described("", "why there is no test; empty when there is one")]
    delay: Annotated[
        OpenNumber, Field(alias="seconds"), described("s", "positive when the forces lag")
    ] = np.nan
    std: Annotated[OpenNumber, described("s", "standard deviation of the delay")] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the two-sided test of no delay")
    ] = np.nan
    failed: Annotated[bool, described("", "there is a delay")] = False

    @classmethod
    def of(cls, test: ColumnTest, cause: Cause) -> Self:
        """Take the test of its column, in which dry friction, without a derivative, has no part."""
        if not test.tested:
            return cls(cause.untested)
        (found,) = test.columns
        return cls("", found.coefficient, found.std, found.log_p, found.failed)

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {"refused": self.refused} if self.refused else fields(self)
