"""Attribution of residuals to effects: forward selection, joint tests, rivals, and findings.

An unmodelled force in one strut also affects the residuals of the others, through biased parameters
and through correlated noise. Therefore the most significant effect is included among the unknowns,
and all others are tested again, until none is significant or more than three causes are needed.
Then every selected effect is tested given the others, and insignificant ones are dropped; an effect
is replaced by a candidate that explains more in its place. Without effects, the rate of false
alarms follows the families' levels.

An effect is certain if it has no rival, not even noise, and the effects found explain the
residuals. A rival is another candidate that, in its place, leaves the effect itself insignificant;
rivals are reported with the effect. If a lack of fit remains, if more than three causes are needed,
or if an effect has an impossible sign or size, something that is not in the list acts on the
forces, and the effects only imitate it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import Finding, join_words, name_channels
from estimation.diagnostics.hypothesis import (
    MODELLED,
    PERIODIC,
    Family,
    Hypothesis,
    PeriodicForce,
    periodic_force,
)
from estimation.diagnostics.joint_system import JointSystem
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.residuals import HarmonicLackOfFit, LackOfFit
from estimation.diagnostics.search import (
    RIVAL_LEVEL,
    EffectCandidate,
    EffectTests,
    Search,
    column_indices,
    exclude,
    periodic_fits,
)
from estimation.diagnostics.significance import HYPOTHESES, POSITION_PERIODIC, Strut
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import Numbers, OpenNumber, described

REMAINDER = 0.02
"""Share of the strongest effect's statistic below which another may be its remainder."""
CHANCE = float(np.log(RIVAL_LEVEL / HYPOTHESES))
"""Largest logarithm of p over its limit that excludes noise over all families."""
_MOST = 12
"""Largest number of effects: one cause may act in all struts."""
MOST_ALTERNATIVES = 3
"""Largest number of kinds of rivals that the contradiction names."""
_MOST_CAUSES = 3
"""Largest number of causes that are believed together; in several struts each counts once."""

_SUSPICIOUS = 0.02
"""p of the low harmonics given the effects, below which no effect is certain."""

_BOTH = ", or both, with this lag in all"
_IMITATED = "do not add it to the model: look for the cause of the unexplained residuals first"


@dataclass(frozen=True)
class Rival:
    """Alternative effect that explains the residuals about as well."""

    kind: Annotated[str, described("", "as for an effect")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[str, described("", "as for an effect")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p if it replaces the effect")]


@dataclass(frozen=True, eq=False)
class Effect:
    """Unmodelled effect in the residuals, fitted jointly with all other effects."""

    kind: Annotated[str, described("", "position-periodic, or a family of hypotheses")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[
        str,
        described(
            "", "parameters; base or platform for a joint; force or length for a lag; else empty"
        ),
    ]
    log_p: Annotated[
        OpenNumber,
        described("1", "logarithm of p given all other effects, corrected for its family"),
    ]
    force: Annotated[PeriodicForce | None, described("", "force of a position-periodic effect")]
    value: Annotated[OpenNumber, described("SI", "size of the effect, or the first of its values")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the value")]
    values: Annotated[Numbers, described("SI", "all values, such as the coordinates of a joint")]
    stds: Annotated[Numbers, described("SI", "standard deviations of the values")]
    constant: Annotated[OpenNumber, described("SI", "a speed, of Stribeck friction")]
    rivals: Annotated[
        tuple[Rival, ...],
        described("", "alternatives that explain it about as well; empty: it is certain"),
    ]

    remainder: Annotated[
        bool, described("", "weak enough to be a linearisation error of another effect")
    ] = False
    chance: Annotated[
        bool, described("", "p over all families is above 0.1 %: it may be noise")
    ] = False

    doubt: Annotated[
        str,
        described(
            "",
            "reason to believe that it only imitates an effect that is not in the list; otherwise "
            "empty",
        ),
    ] = ""

    @property
    def certain(self) -> bool:
        """Whether the effect has no alternative explanation."""
        return not (self.rivals or self.remainder or self.chance or self.doubt)


@dataclass(frozen=True, eq=False)
class Attribution:
    """Effects in the residuals of one experiment, with all their tests."""

    hypotheses: tuple[Hypothesis, ...]
    """Tested families of hypotheses."""
    effects: tuple[Effect, ...]
    """Effects found, most significant first."""
    first: EffectTests
    last: EffectTests
    """Tests without known effects, and given all effects found."""
    columns: Signature
    """Columns of all effects."""
    best_forces: tuple[PeriodicForce | None, ...]
    """The best-fitting position-periodic force of every strut, significant or not."""
    periodic_level: float
    """Level of all pitch scans together."""
    products: Array
    """(q, u), zᵀ W U of every column z of the hypotheses and the unknowns of the joint fit."""
    unlisted: bool = False
    """Something that is not in the list acts on the forces; the effects may only imitate it."""


def attribute(
    system: JointSystem,
    part: Linearisation,
    families: tuple[Hypothesis, ...],
    step: float,
    *,
    experiments: int = 1,
) -> Attribution:
    """Find the effects in the residuals of one experiment, with samples `step` apart, s.

    The families are tested in addition to forces periodic in a strut's length, whose level so many
    `experiments` share; the families state their own levels.
    """
    search = Search(system, part, families, step, POSITION_PERIODIC / experiments)
    first = last = search.run_tests(())
    products = search.projection.products
    found: list[EffectCandidate] = []
    seen: set[frozenset[tuple[str, int | None, str]]] = set()
    ended = False
    while not ended:
        last, found, ended = _add_effects(search, last, found, seen)
        tested_given = found
        found, rivals = search.exchange_for_rivals(found)
        if {id(item) for item in found} != {id(item) for item in tested_given}:
            last = search.run_tests(found) if found else first
        ended = ended or _count_causes(search, found) > _MOST_CAUSES
    effects = _effects(search, found, rivals)
    forces = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    others = [
        scan
        for scan in last.scans
        if scan.strut not in forces and np.isfinite(scan.best_pitch) and scan.best > 0
    ]
    fits = periodic_fits(last.solution, part, others)
    for scan, (_, values, covariance) in zip(others, fits, strict=True):
        forces[scan.strut] = periodic_force(part, scan.strut, scan.best_pitch, values, covariance)
    best_forces = tuple(forces.get(scan.strut) for scan in last.scans)
    columns = search.signature.select(column_indices(found))
    return Attribution(families, effects, first, last, columns, best_forces, search.level, products)


def _add_effects(
    search: Search,
    tests: EffectTests,
    found: list[EffectCandidate],
    seen: set[frozenset[tuple[str, int | None, str]]],
) -> tuple[EffectTests, list[EffectCandidate], bool]:
    """Add effects until none is significant, or more causes are needed than are believed.

    `tests` are conditional on the effects found so far. Returns those conditional on all effects,
    these, and whether the search has ended: no effect is significant, or those that were `seen`
    come again.
    """
    while len(found) < _MOST:
        if _count_causes(search, found) > _MOST_CAUSES:
            return tests, found, False
        best = search.find_most_significant(tests, found)
        if best is None:
            break
        found = search.drop_insignificant([*found, best])
        tests = search.run_tests(found)
        names = frozenset(item.name for item in found)
        if names in seen:
            break
        seen.add(names)
    return tests, found, True


def _count_causes(search: Search, found: Sequence[EffectCandidate]) -> int:
    """Return the number of causes among effects; remainders of the strongest do not count."""
    sizes = _sizes_given_others(search, found)
    causes = {
        (item.kind, item.parameter)
        for item, size in zip(found, sizes, strict=True)
        if size >= REMAINDER * max(sizes)
    }
    return len(causes)


def _sizes_given_others(search: Search, found: Sequence[EffectCandidate]) -> list[float]:
    return [search.fit_given(item, exclude(found, item)).statistic for item in found]


_IMPOSSIBLE = "its sign or size is impossible"
_ANOTHER_IMPOSSIBLE = "another effect has an impossible sign or size"


def doubt_effects(
    attribution: Attribution,
    without: HarmonicLackOfFit,
    given: HarmonicLackOfFit,
    lack_given: LackOfFit,
) -> Attribution:
    """Doubt the effects if the tests without them, and given them, show unexplained residuals."""
    effects = attribution.effects
    remains = given.failed or bool(np.any(lack_given.failed))
    causes = {(effect.kind, effect.parameter) for effect in effects if not effect.remainder}
    # Of a delay or a low pass the jumps of dry friction leave a remainder of any sign.
    lags = {one.kind for one in attribution.hypotheses if one.sized_by_constant}
    late = bool(effects) and effects[0].kind in lags
    impossible = any(effect.doubt and not (late and effect.remainder) for effect in effects)
    many = len(causes) > _MOST_CAUSES
    reasons = {
        f"more than {_MOST_CAUSES} causes are needed": many,
        "a lack of fit remains": remains,
        _ANOTHER_IMPOSSIBLE: impossible,
        "a lack of fit may remain": given.log_p < np.log(_SUSPICIOUS),
    }
    reason = next((words for words, holds in reasons.items() if holds), "")
    if not reason:
        return attribution
    # Large effects leave an error of linearisation.
    linear = given.excess < REMAINDER * without.excess
    unlisted = (remains and not linear) or many or impossible
    doubted = tuple(replace(each, doubt=each.doubt or reason) for each in effects)
    return replace(attribution, effects=doubted, unlisted=unlisted)


def doubts_in_words(effects: Sequence[Effect]) -> str:
    """Join the doubts about effects."""
    found = dict.fromkeys(effect.doubt for effect in effects)
    if len(effects) > 1:
        one = "one of them has an impossible sign or size"
        impossible = (_IMPOSSIBLE, _ANOTHER_IMPOSSIBLE)
        found = dict.fromkeys(one if doubt in impossible else doubt for doubt in found)
    return join_words(found)


def _effects(
    search: Search,
    found: Sequence[EffectCandidate],
    rivals: Sequence[tuple[EffectCandidate, ...]],
) -> tuple[Effect, ...]:
    """Fit all effects jointly."""
    fit = search.projection.conditional_on(()).fit(column_indices(found))
    effects, first = [], 0
    sizes, excesses = _sizes_given_others(search, found), search.conditional_excesses(found)
    for item, others, size, excess in zip(found, rivals, sizes, excesses, strict=True):
        chosen = slice(first, first + len(item.places))
        first = chosen.stop
        values, covariance = fit.values[chosen], fit.covariance[chosen, chosen]
        if item.hypothesis.sized_by_constant:
            values = np.array([item.constant])
        effect = build_effect(item, excess, (values, covariance), others)
        if (scan := item.scan) is not None:
            force = periodic_force(search.part, scan.strut, scan.best_pitch, values, covariance)
            long = force.pitch > np.ptp(search.part.position[:, scan.strut])
            effect = replace(
                effect,
                force=force,
                value=force.amplitude,
                std=force.amplitude_std,
                chance=False,  # its level is that of rivals
                doubt="the pitch is longer than the stroke" * bool(long),
            )
        effects.append(replace(effect, remainder=size < REMAINDER * max(sizes)))
    return tuple(effects)


def build_effect(
    item: EffectCandidate,
    excess: float,
    fit: tuple[Array, Array],
    rivals: Sequence[EffectCandidate],
) -> Effect:
    """Build an effect from the log p of a candidate less its limit, and from values and covariance.

    `rivals` are its alternatives.
    """
    values, covariance = fit
    stds = np.sqrt(np.diag(covariance))
    return Effect(
        kind=item.kind,
        strut=item.strut,
        parameter=item.parameter,
        log_p=excess + float(np.log(item.hypothesis.level)),
        force=None,
        value=float(values[0]),
        std=float(stds[0]),
        values=values,
        stds=stds,
        constant=item.constant,
        rivals=tuple(Rival(*rival.name, rival.log_p) for rival in rivals),
        chance=excess > CHANCE,
        doubt="" if item.is_possible(values, covariance) else _IMPOSSIBLE,
    )


def position_periodic_finding(attribution: Attribution) -> Finding:
    """Report whether forces are periodic in a strut's length."""
    level = attribution.periodic_level
    if not any(len(scan.pitches) for scan in attribution.first.scans):
        return PERIODIC.assumption.skip(
            "no pitch could be scanned: the struts move too far between two samples"
        )
    effects = sorted(
        ((e.strut, e.force) for e in attribution.effects if e.strut is not None and e.force),
        key=lambda found: found[0],
    )
    if not effects:
        p = min(1.0, ACTUATORS * np.exp(min(scan.log_p for scan in attribution.last.scans)))
        return PERIODIC.assumption.holds(PERIODIC.absent.format(p=p), p, level)
    where = name_channels("strut", np.isin(np.arange(ACTUATORS), [strut for strut, _ in effects]))
    forces = [
        f"strut {strut + 1} {force.amplitude:.3g} ± {force.amplitude_std:.1g} N, pitch "
        f"{1e3 * force.pitch:.4g} ± {1e3 * force.pitch_std:.1g} mm"
        for strut, force in effects
    ]
    own = [effect for effect in attribution.effects if effect.kind == PERIODIC.kind]
    return _add_doubts(
        attribution,
        own,
        PERIODIC.assumption.fails(
            f"position-periodic force (cogging) in {where}: {'; '.join(forces)}",
            _smallest_p(own),
            level,
            where=where,
        ),
    )


def hypothesis_finding(attribution: Attribution, hypothesis: Hypothesis) -> Finding:
    """Report whether there is an effect of a family of hypotheses."""
    assumption = hypothesis.assumption
    last = attribution.last.families[hypothesis.kind]
    effects = [effect for effect in attribution.effects if effect.kind == hypothesis.kind]
    if not attribution.first.families[hypothesis.kind].tested:
        return assumption.skip(MODELLED if hypothesis.labels else hypothesis.reason_untested)
    if not effects:
        value, std = 0.0, 0.0
        if last.tested:
            fit = last.fits[last.best]
            value = hypothesis.scale * fit.values[0]
            std = hypothesis.scale * float(np.sqrt(fit.covariance[0, 0]))
        return assumption.holds(
            hypothesis.absent.format(p=last.best_p, value=value, std=std),
            last.best_p,
            hypothesis.level,
        )
    found = assumption.fails(
        "; ".join(_describe(hypothesis, effect) for effect in effects),
        _smallest_p(effects),
        hypothesis.level,
        where=", ".join(dict.fromkeys(_place(effect) for effect in effects if _place(effect))),
    )
    return _add_doubts(attribution, effects, found)


def _describe(hypothesis: Hypothesis, effect: Effect) -> str:
    """Describe an effect with its place and size."""
    unit = hypothesis.unit_of(effect.parameter)
    numbers = [
        f"{hypothesis.scale * value:{hypothesis.number}} ± {hypothesis.scale * std:.1g}"
        for value, std in _sizes(effect, hypothesis)
    ][: hypothesis.values_shown]
    constant = f", velocity {effect.constant:g} m/s" if effect.kind == "stribeck" else ""
    size = f"{', '.join(numbers)} {unit}{constant}"
    rest = ", perhaps a remainder of the strongest effect" * effect.remainder
    rest += ", perhaps noise" * effect.chance
    name = _name_effects(effect.kind, [_place(effect)], {hypothesis.kind: hypothesis})
    return f"{name} ({size}{rest})"


def _sizes(effect: Effect, hypothesis: Hypothesis) -> Iterator[tuple[float, float]]:
    """Yield the values, or the amplitudes, of an effect with standard deviations."""
    pairs = zip(effect.values.tolist(), effect.stds.tolist(), strict=True)
    if not hypothesis.paired:
        yield from pairs
        return
    for (sine, sine_std), (cosine, cosine_std) in zip(pairs, pairs, strict=True):
        amplitude = float(np.hypot(sine, cosine))
        yield amplitude, float(np.hypot(sine * sine_std, cosine * cosine_std)) / amplitude


def _place(effect: Effect | Rival) -> str:
    """Return the place of an effect, such as ``p4 in actuator 3`` or ``base joint 2``."""
    if effect.kind == "joint" and effect.strut is not None:
        return f"{effect.parameter} joint {effect.strut + 1}"
    number = "" if effect.strut is None else f"in actuator {effect.strut + 1}"
    return f"{effect.parameter} {number}".strip()


def _add_doubts(attribution: Attribution, effects: Sequence[Effect], found: Finding) -> Finding:
    """Add the doubts about effects, and their rivals, to a finding."""
    if attribution.unlisted:
        doubts = doubts_in_words(effects)
        sentence = f"the residuals resemble {found.sentence}, which may only imitate another effect"
        return replace(found, sentence=f"{sentence}: {doubts}", advice=_IMITATED, serious=False)
    several = len(effects) > 1
    hypotheses = {hypothesis.kind: hypothesis for hypothesis in attribution.hypotheses}
    alternatives = []
    for effect in effects:
        places: dict[str, list[str]] = {}
        for rival in effect.rivals:
            places.setdefault(rival.kind, []).append(_place(rival))
        if places:
            others = " or ".join(
                _name_effects(kind, each, hypotheses) for kind, each in places.items()
            )
            place = (
                f"instead of {_name_effects(effect.kind, [_place(effect)], hypotheses)} " * several
            )
            lags = {one.kind for one in hypotheses.values() if one.sized_by_constant}
            both = effect.kind in lags and not lags.isdisjoint(places)
            alternatives.append(f"{place}it may also be {others}{_BOTH * both}")
    if not alternatives and not any(effect.doubt for effect in effects):
        return found
    return replace(
        found,
        sentence="; ".join((found.sentence, *alternatives)),
        contradiction=f"{found.contradiction}, or {_name_rivals(effects, hypotheses)}",
    )


def _name_rivals(effects: Sequence[Effect], hypotheses: Mapping[str, Family]) -> str:
    """Name the kinds of the rivals, if they are few: ``there is a constant force instead``."""
    kinds = dict.fromkeys(rival.kind for effect in effects for rival in effect.rivals)
    others = [kind for kind in kinds if kind != effects[0].kind]
    if not others or len(others) > MOST_ALTERNATIVES:
        return "a similar effect"
    nouns = [_complete_noun(hypotheses.get(kind, PERIODIC).noun) for kind in others]
    return f"there is {' or '.join(nouns)} instead"


def _name_effects(kind: str, places: Sequence[str], hypotheses: Mapping[str, Family]) -> str:
    """Name effects of one kind with their places, such as ``a spring in actuator 1``."""
    family = hypotheses.get(kind, PERIODIC)
    everywhere = family.noun if "" in places else ""
    place = join_words(places)
    return join_words([everywhere, place and family.phrase.format(noun=family.noun, place=place)])


def describe_candidate(
    hypothesis: Hypothesis, parameter: str, strut: int | None, values: Array
) -> str:
    """Describe a candidate up to a size, SI: ``an inertia of the drives (up to 0.045 kg)``."""
    place = _place(Rival(hypothesis.kind, strut, parameter, 0.0))
    name = _name_effects(hypothesis.kind, [place], {hypothesis.kind: hypothesis})
    unit = hypothesis.unit_of(parameter)
    # Values of one unit are shown as the norm of their vector.
    sizes = np.abs(values) if "," in unit else [np.linalg.norm(values)]
    form = hypothesis.number.removeprefix("+")
    numbers = ", ".join(f"{hypothesis.scale * size:{form}}" for size in sizes)
    # Springs have constant forces or moments, since their rest position is unknown.
    text = f"up to {numbers} {unit}{', with any constant force' * bool(hypothesis.contains)}"
    return f"{name[:-1]}: {text})" if name.endswith(")") else f"{name} ({text})"


def effect_nouns(attribution: Attribution) -> dict[str, str]:
    """Return the nouns of effects without a place, by their kind."""
    families = (PERIODIC, *attribution.hypotheses)
    return {family.kind: _complete_noun(family.noun) for family in families}


def _complete_noun(noun: str) -> str:
    """Complete the noun of a family that a place would complete.

    Examples
    --------
    >>> [_complete_noun(noun) for noun in ("a delay", "a lag of the", "another value of")]
    ['a delay', 'a lag of a channel', 'another value of a parameter']
    """
    if noun.endswith(" of the"):
        return f"{noun.removesuffix(' the')} a channel"
    return f"{noun} a parameter" if noun.endswith(" of") else noun


def effect_strengths(attribution: Attribution) -> dict[str, float]:
    """Return −log p of the strongest effect of every kind, the strongest kind first."""
    strengths: dict[str, float] = {}
    for effect in sorted(attribution.effects, key=lambda effect: effect.log_p):
        strengths.setdefault(effect.kind, -effect.log_p)
    return strengths


def _smallest_p(effects: Sequence[Effect]) -> float:
    """Return the smallest p of effects of one kind, corrected for their family."""
    return float(np.exp(min(effect.log_p for effect in effects)))
