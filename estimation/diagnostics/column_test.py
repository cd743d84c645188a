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
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_serializer
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.channel_test import COLUMNS, DELAY
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
    """A family of candidate causes that are tested alike and named in the same words.

    Attributes
    ----------
    kind : str
        Of the effects that are found.
    labels : tuple of (str, int or None)
        Of the columns.
    columns : (R, 6, q)
        N per unit of the effect.
    level : float
        Of the family.
    assumption : Assumption
        That there is no such effect.
    words : str
        What such an effect is, in the advice on a bias.
    present, absent : str
        The sentences when effects were found and when none was; the latter is a format of `p`,
        `value` and `std` of the most significant column.
    untested : str
        Why there is no test when no column is left.
    scale : float
        From SI to the unit shown.
    number : str
        Format of a value.
    unit : callable
        Parameter → unit shown.
    """

    kind: str
    labels: tuple[Label, ...]
    columns: Array
    level: float
    assumption: Assumption
    words: str
    present: str
    absent: str
    untested: str
    scale: float = 1.0
    number: str = "+.3g"
    unit: Callable[[str], str] = parameter_unit


@dataclass(frozen=True, eq=False)
class ColumnTest:
    """Tests of all columns of a family.

    Attributes
    ----------
    labels : tuple of (str, int or None)
        Parameter and actuator (from 0; None: all of them).
    coefficients, std : (q,)
        By how much the parameter would differ, if it alone did, and its standard deviation, SI.
    statistic : (q,)
        t; NaN where the model's own columns leave nothing to test.
    log_p : (q,)
        Logarithm of each two-sided p-value, for the test alone.
    level : float
        Of the family.
    """

    labels: tuple[Label, ...]
    coefficients: Array
    std: Array
    statistic: Array
    log_p: Array
    level: float = COLUMNS

    @property
    def tested(self) -> int:
        """Size of the family."""
        return int(np.count_nonzero(np.isfinite(self.statistic)))

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(q,) columns on which residuals are left."""
        return np.nan_to_num(self.log_p, nan=0.0) < np.log(self.level / max(self.tested, 1))

    def detectable(self, power: float = POWER) -> Array:
        """Return the smallest error of each parameter, (q,), that is found with this power."""
        critical = stats.norm.isf(self.level / max(self.tested, 1) / 2)
        return self.std * (critical + stats.norm.ppf(power))


def causes(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool, experiments: int = 1
) -> tuple[Cause, ...]:
    """Return the families that are tested; each of several experiments gets its share of a level.

    Parameters
    ----------
    names : tuple of str
        Of the regressor's columns.
    held_out : bool
        The parameters were not estimated from these data.
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
    delay = part.delay_column
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
            labels=() if delay is None else (("", None),),
            columns=np.zeros((*part.forces.shape, 0)) if delay is None else delay[:, :, None],
            level=DELAY / experiments,
            assumption=Assumption(
                "forces and lengths are sampled at the same time",
                "the forces lag behind the lengths",
                "give the delay in `data.delay` and estimate again",
            ),
            words="a delay between the channels",
            present="the forces lag behind the lengths",
            absent="the forces lag by {value:.3g} ± {std:.1g} ms",
            untested="pointwise kinematics give no derivative of the forces in time"
            if delay is None
            else "the forces do not change in time",
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
    safe = np.where(seen, information, 1.0)
    statistic = np.where(seen, score / np.sqrt(safe), np.nan)
    return ColumnTest(
        labels=cause.labels,
        coefficients=np.where(seen, score / safe, np.nan),
        std=np.where(seen, 1 / np.sqrt(safe), np.nan),
        statistic=statistic,
        log_p=log_two_sided(statistic, solved.system.freedom),
        level=cause.level,
    )


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
    level: Annotated[float, Field(exclude=True), described("1", "of the test")] = DELAY

    @property
    def failed(self) -> bool:
        """Tell whether there is a delay."""
        return bool(np.isfinite(self.log_p) and self.log_p < np.log(self.level))

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return (
            {"refused": self.refused} if self.refused else {**fields(self), "failed": self.failed}
        )


def delay_test(test: ColumnTest, cause: Cause) -> DelayTest:
    """Take the test of its column, in which dry friction, without a derivative, has no part."""
    if not test.tested:
        return DelayTest(cause.untested, level=cause.level)
    delay, std, log_p = (float(values[0]) for values in (test.coefficients, test.std, test.log_p))
    return DelayTest("", delay, std, log_p, cause.level)
