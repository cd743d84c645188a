"""Test of the tolerances: deviations of the machine estimated with the parameters.

Machines within their tolerances Θ have estimates θ̂ with the covariance Θ − Cov(θ̂ − θ): what the
data say nothing of stays at zero. Each entry, each group and all entries together are compared with
it; combinations that the data hardly show are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.diagnostics.significance import TOLERANCES
from estimation.estimators.result import SEEN, ParameterEstimate
from expdesign.robot.deviation import Deviation

_WITHIN = Assumption(
    "the machine is within its tolerances",
    "a deviation of the machine exceeds its tolerance",
    "measure these quantities again, or state larger tolerances; if the tolerances are right, the "
    "model lacks an effect that the deviations imitate",
)
_SEVERAL = replace(
    _WITHIN,
    contradiction="only tolerances of several parts together explain an error",
    advice="the model probably lacks an effect that these deviations imitate: compare with "
    "`estimate.systematic: budget`, whose residuals show it; or state larger tolerances",
)
_NAMED = 3.0
"""Size of a named deviation, in standard deviations of its estimate."""
_MOST_NAMED = 4


def tolerance_findings(estimate: ParameterEstimate) -> tuple[Finding, ...]:
    """Compare estimated deviations with their tolerances; empty if none was estimated."""
    case = _Case.of(estimate)
    if case is None:
        return ()
    groups = list(dict.fromkeys(one.group for one in case.entries))
    everything = case.joint_test(np.ones(len(case.entries), dtype=bool))
    each = {
        group: case.joint_test(np.array([one.group == group for one in case.entries]))
        for group in groups
    }
    tests = [everything, *(test for test in each.values() if test.freedom and len(groups) > 1)]
    seen = np.flatnonzero(case.z)
    smallest = min([test.p for test in tests] + (2 * scipy.stats.norm.sf(abs(case.z))).tolist())
    p, level = min(1.0, (len(tests) + len(seen)) * smallest), TOLERANCES
    total = f"χ² = {everything.statistic:.3g} for {everything.freedom} combinations"
    if p >= level:
        sentence = f"the estimated deviations are within their tolerances ({total})"
        return (_WITHIN.holds(sentence, p, level),)
    if far := case.exceeding():
        names = [case.entries[k].name for k in far[:_MOST_NAMED]]
        where = join_words(names if len(far) <= _MOST_NAMED else [*names, "others"])
        numbers = "; ".join(case.describe(k) for k in far[:_MOST_NAMED])
        return (_WITHIN.fails(f"estimated deviations: {numbers}", p, level, where),)
    doubtful = [group for group, test in each.items() if test.p < 2 * scipy.stats.norm.sf(_NAMED)]
    where = join_words(f"`tolerances.{group}`" for group in doubtful or groups)
    sentence = f"no estimated deviation exceeds its tolerance, but all together do ({total})"
    return (_SEVERAL.fails(sentence, p, level, where),)


@dataclass(frozen=True)
class _JointTest:
    statistic: float
    freedom: int
    p: float


@dataclass(frozen=True, eq=False)
class _Case:
    """Estimated deviations with a tolerance."""

    entries: Sequence[Deviation]
    theta: Array
    """(t,), estimates in units of the tolerances."""
    covariance: Array
    """(t, t), of these in machines within their tolerances."""
    std: Array
    """(t,), standard deviations of the errors, SI."""

    @classmethod
    def of(cls, estimate: ParameterEstimate) -> _Case | None:
        scatter, systematic = estimate.deviation_scatter, estimate.systematic
        if systematic is None or not len(scatter):
            return None
        own = np.flatnonzero(systematic.tolerances[: len(scatter)] > 0)
        if not len(own):
            return None
        tolerances = systematic.tolerances[own]
        return cls(
            [systematic.deviations[k] for k in own],
            systematic.values[own] / tolerances,
            scatter[np.ix_(own, own)] / np.multiply.outer(tolerances, tolerances),
            systematic.std[own],
        )

    @property
    def z(self) -> Array:
        """(t,), estimates in their standard deviations; 0 where the data say nothing."""
        return self._z_given([])

    def exceeding(self) -> list[int]:
        """Return the entries that exceed their tolerances, given each other, the largest first.

        An entry is left out if the others explain its estimate: several displaced joints shift
        that of the common force constant, too.
        """
        named: list[int] = []
        while len(named) < np.count_nonzero(self.z):
            left = abs(self._z_given(named))
            worst = int(np.argmax(left))
            if left[worst] <= _NAMED:
                break
            named.append(worst)
        for k in sorted(named, key=lambda k: abs(self.z[k])):
            others = [each for each in named if each != k]
            named = named if abs(self._z_given(others)[k]) > _NAMED else others
        return sorted(named, key=lambda k: -abs(self.z[k]))

    def _z_given(self, known: list[int]) -> Array:
        """Return the estimates in their standard deviations, (t,), if others may have any size."""
        cross = self.covariance[:, known]
        slope = cross @ np.linalg.pinv(self.covariance[np.ix_(known, known)], hermitian=True)
        std = np.sqrt(np.maximum(np.diag(self.covariance) - np.sum(slope * cross, axis=1), 0.0))
        rest = self.theta - slope @ self.theta[known]
        return np.where(std > SEEN, rest / np.maximum(std, SEEN), 0.0)

    def joint_test(self, places: NDArray[np.bool_]) -> _JointTest:
        """Test some entries together, in the combinations that the data show."""
        values, vectors = np.linalg.eigh(self.covariance[np.ix_(places, places)])
        shown = values > SEEN**2
        along = self.theta[places] @ vectors[:, shown]
        statistic, freedom = float(np.sum(along**2 / values[shown])), int(np.sum(shown))
        p = float(scipy.stats.chi2.sf(statistic, freedom)) if freedom else 1.0
        return _JointTest(statistic, freedom, p)

    def describe(self, k: int) -> str:
        """Return an estimate with its tolerance in words."""
        one = self.entries[k]
        scale, unit = (100.0, "%") if one.unit == "1" else (1.0, one.unit)
        value, std, tolerance = (
            scale * one.tolerance * self.theta[k],
            scale * self.std[k],
            scale * one.tolerance,
        )
        return (
            f"{one.name} {value:+.3g} ± {std:.1g} {unit}, tolerance {tolerance:.3g} {unit} "
            f"(z = {self.z[k]:+.1f})"
        )
