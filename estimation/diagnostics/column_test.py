"""t-tests of the residuals on the regressor's columns: which parameter is wrong, and where.

Held-out data: every column, over all actuators. Data that were fitted have no score on the columns
of the estimated parameters; there, each column is tested in one actuator at a time, which finds a
parameter that is not the same in all struts, and the whole columns of parameters that were fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.levels import COLUMNS
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.tails import log_two_sided
from expdesign.mechanism.hexapod import ACTUATORS

POWER = 0.8
"""Of the test, for which the smallest error that is found is told."""
_SEEN = 1e-6
"""Share of a column's information that the model's own columns must leave."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Columns that are tested.

    Attributes
    ----------
    labels : tuple of (str, int or None)
        Parameter and actuator (from 0; None: all of them).
    columns : (R, 6, q)
        N per unit of the parameter.
    """

    labels: tuple[tuple[str, int | None], ...]
    columns: Array


@dataclass(frozen=True, eq=False)
class ColumnTest:
    """Tests of all candidates.

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

    labels: tuple[tuple[str, int | None], ...]
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


def column_candidates(part: Linearisation, names: tuple[str, ...], *, held_out: bool) -> Candidates:
    """Choose what is tested."""
    labels: list[tuple[str, int | None]] = []
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
    return Candidates(tuple(labels), stacked)


def column_test(solved: SolvedSystem, candidates: Candidates, level: float = COLUMNS) -> ColumnTest:
    """Test each candidate by itself."""
    score, information, whole = solved.scores(candidates.columns)
    seen = information > _SEEN * np.where(whole > 0, whole, np.inf)
    safe = np.where(seen, information, 1.0)
    statistic = np.where(seen, score / np.sqrt(safe), np.nan)
    return ColumnTest(
        labels=candidates.labels,
        coefficients=np.where(seen, score / safe, np.nan),
        std=np.where(seen, 1 / np.sqrt(safe), np.nan),
        statistic=statistic,
        log_p=log_two_sided(statistic, solved.system.freedom),
        level=level,
    )
