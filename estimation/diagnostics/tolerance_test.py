"""Test of the tolerances: deviations of the machine estimated with the parameters.

Machines within their tolerances Θ have estimates θ̂ with the covariance Θ − Cov(θ̂ − θ): what the
data say nothing of stays at zero. Each entry, each group and all entries together are compared with
it; combinations that the data hardly show are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.diagnostics.joint_system import ConditionalScores, EffectFit
from estimation.diagnostics.significance import POWER, TOLERANCES
from estimation.estimators.covariance import EstimatedDeviation
from estimation.estimators.result import SEEN, ParameterEstimate

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
_AT_THE_EDGE = replace(
    _WITHIN,
    contradiction="a deviation of the machine is at the edge of its tolerance",
    advice="measure these quantities again, or state the tolerances that they really have",
    serious=False,
)
_NAMED = 3.0
"""Size of a named deviation, in standard deviations of its estimate."""
_MOST_NAMED = 4


def tolerance_findings(estimate: ParameterEstimate) -> tuple[Finding, ...]:
    """Compare estimated deviations with their tolerances; empty if none was estimated."""
    scatter, systematic = estimate.deviation_scatter, estimate.systematic
    if systematic is None:
        return ()
    own = np.flatnonzero(systematic.tolerances[: len(scatter)] > 0)
    if not len(own):
        return ()
    entries, tolerances = [systematic.deviations[k] for k in own], systematic.tolerances[own]
    # The estimates in units of the tolerances, and their covariance in machines within them.
    covariance = scatter[np.ix_(own, own)] / np.multiply.outer(tolerances, tolerances)
    theta = systematic.values[own] / tolerances
    scores = ConditionalScores(theta, covariance, np.ones(len(own)), np.inf)
    places: dict[str, list[int]] = {}
    for k, one in enumerate(entries):
        places.setdefault(one.group, []).append(k)
    everything, p_all = _joint_test(scores, range(len(own)))
    each = {group: _joint_test(scores, at) for group, at in places.items()}
    p_values = [p_all, *(p for fit, p in each.values() if fit.rank and len(places) > 1)]
    z = _z(scores)
    smallest = min([*p_values, *(2 * scipy.stats.norm.sf(abs(z))).tolist()])
    p, level = min(1.0, (len(p_values) + np.count_nonzero(z)) * smallest), TOLERANCES
    total = f"χ² = {everything.statistic:.3g} for {everything.rank} combinations"
    if p >= level:
        edge = np.flatnonzero(abs(theta) >= _NAMED).tolist()
        if edge:
            numbers = "; ".join(_describe(entries[k], z[k]) for k in edge[:_MOST_NAMED])
            where = join_words(entries[k].name for k in edge)
            return (_AT_THE_EDGE.fails(f"estimated deviations: {numbers}", p, level, where),)
        sentence = f"the estimated deviations are within their tolerances ({total})"
        return (_WITHIN.holds(sentence, p, level),)
    if far := _exceeding(scores):
        names = [entries[k].name for k in far[:_MOST_NAMED]]
        where = join_words(names if len(far) <= _MOST_NAMED else [*names, "others"])
        numbers = "; ".join(_describe(entries[k], z[k]) for k in far[:_MOST_NAMED])
        advice = _delay_advice([entries[k] for k in far])
        return (_WITHIN.fails(f"estimated deviations: {numbers}", p, level, where, advice),)
    least = 2 * scipy.stats.norm.sf(_NAMED)
    doubtful = [group for group, (_, own_p) in each.items() if own_p < least]
    where = join_words(f"`tolerances.{group}`" for group in doubtful or places)
    sentence = f"no estimated deviation exceeds its tolerance, but all together do ({total})"
    return (_SEVERAL.fails(sentence, p, level, where),)


def hidden_error(tolerance: float, std: float, entries: int) -> float:
    """Return the largest error of a quantity that its tolerance hides with a probability of 20 %.

    The estimate of an error δ has the mean δ (1 − std²/tolerance²), and √(tolerance² − std²) in
    machines within the tolerances. `entries` is the number of deviations that share the level.

    Examples
    --------
    >>> f"{hidden_error(1.0, 0.1, 50):.1f}", hidden_error(1.0, 1.0, 50)
    ('5.1', inf)
    """
    scatter = np.sqrt(max(tolerance**2 - std**2, 0.0))
    if scatter <= SEEN * tolerance:
        return np.inf
    far = scipy.stats.norm.isf(TOLERANCES / entries / 2) + scipy.stats.norm.ppf(POWER)
    return float(far * tolerance**2 / scatter)


def _joint_test(scores: ConditionalScores, places: Sequence[int]) -> tuple[EffectFit, float]:
    """Test some entries together, in the combinations that the data show; return p as well."""
    fit = scores.fit(places, SEEN**2)
    return fit, float(scipy.stats.chi2.sf(fit.statistic, fit.rank)) if fit.rank else 1.0


def _z(scores: ConditionalScores) -> Array:
    """Return the estimates in their standard deviations; 0 where the data say nothing."""
    std = np.sqrt(np.maximum(np.diag(scores.information), 0.0))
    return np.where(std > SEEN, scores.score / np.maximum(std, SEEN), 0.0)


def _exceeding(scores: ConditionalScores) -> list[int]:
    """Return the entries that exceed their tolerances, given each other, the largest first.

    An entry is left out if the others explain its estimate: several displaced joints shift those of
    the lengths' zeros, too.
    """
    named: list[int] = []
    size = abs(_z(scores))
    while (
        np.max(left := np.where(size > _NAMED, abs(_z(scores.conditional_on(named))), 0)) > _NAMED
    ):
        named.append(int(np.argmax(left)))
    for k in sorted(named, key=lambda k: size[k]):
        others = [each for each in named if each != k]
        named = named if abs(_z(scores.conditional_on(others))[k]) > _NAMED else others
    return sorted(named, key=lambda k: -size[k])


_SHOWN = {
    "1": (100.0, "%"),
    "m": (1e3, "mm"),
    "s": (1e3, "ms"),
    "rad": (float(np.rad2deg(1.0)), "deg"),
}


def shown_unit(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which deviations with an SI unit are displayed.

    Examples
    --------
    >>> shown_unit("m"), shown_unit("N")
    ((1000.0, 'mm'), (1.0, 'N'))
    """
    return _SHOWN.get(unit, (1.0, unit))


def _describe(one: EstimatedDeviation, z: float) -> str:
    """Return an estimate with its tolerance in words."""
    scale, unit = shown_unit(one.unit)
    value, std, tolerance = (scale * number for number in (one.value, one.std, one.tolerance))
    return (
        f"{one.name} {value:+.3g} ± {std:.1g} {unit}, tolerance {tolerance:.3g} {unit} "
        f"(z = {z:+.1f})"
    )


def _delay_advice(far: Sequence[EstimatedDeviation]) -> str:
    """Return advice for a delay beyond its tolerance; empty if there is none."""
    late = [one for one in far if one.group == "delay"]
    if not late:
        return ""
    # Without the prior, which draws the estimate towards zero.
    size = late[0].value / (1 - (late[0].std / late[0].tolerance) ** 2)
    channel = "forces" if size > 0 else "lengths"
    stated = f"`data.delay: {{{channel}: {1e3 * abs(size):.3g} ms}}`"
    return f"{stated}, in addition to one that is stated; or {_WITHIN.advice}"
