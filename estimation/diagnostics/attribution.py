"""What the residuals come from: forward selection among causes, judged together, with rivals.

An unmodelled force in one strut also leaves traces in the others, through the parameters that it
has moved and through correlated noise. Therefore the most significant effect is taken as known,
with its columns among the unknowns, and all others are tested again, until none is left. Then all
that were selected are judged beside each other, and what is not significant there is dropped; an
effect gives way to another that explains more in its place. As long as there is no effect nothing
is selected but at the levels of the families.

An effect is named for sure when no rival is left: another candidate, put in its place, would have
to leave nothing significant for the effect itself. Rivals that do are named with it.

What was found of the causes of residuals, in words, with what cannot be told apart from them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from estimation.diagnostics.finding import Assumption, Finding, join_words, name_channels
from estimation.diagnostics.hypothesis import Hypothesis
from estimation.diagnostics.joint_system import JointSystem, SolvedSystem
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.periodic_forces import (
    PeriodicForce,
    PitchScan,
    periodic_force,
)
from estimation.diagnostics.search import (
    PERIODIC,
    EffectCandidate,
    EffectTests,
    Search,
    periodic_fit,
    places_of,
    without,
)
from estimation.diagnostics.significance import POSITION_PERIODIC, Strut
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import Numbers, OpenNumber, described

REMAINDER = 0.02
"""Share of the strongest effect's statistic below which another may be what it leaves."""
_MOST = 12
"""Effects that are looked for: whoever has more needs another model."""


@dataclass(frozen=True)
class Rival:
    """Another effect that explains the residuals about as well in the place of one."""

    kind: Annotated[str, described("", "as of an effect")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[str, described("", "as of an effect")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p in the effect's place")]


@dataclass(frozen=True, eq=False)
class Effect:
    """Something in the residuals that the model does not have, fitted with all other effects."""

    kind: Annotated[str, described("", "position-periodic, or a family of causes")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[
        str, described("", "of a column; base or platform of a joint; empty otherwise")
    ]
    log_p: Annotated[
        OpenNumber,
        described("1", "logarithm of p beside all other effects, corrected for its family"),
    ]
    force: Annotated[PeriodicForce | None, described("", "of a position-periodic effect")]
    value: Annotated[OpenNumber, described("SI", "its size, or the first of its values")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the value")]
    values: Annotated[Numbers, described("SI", "all of its values: coordinates of a joint")]
    stds: Annotated[Numbers, described("SI", "their standard deviations")]
    constant: Annotated[OpenNumber, described("SI", "a speed, of Stribeck friction")]
    rivals: Annotated[
        tuple[Rival, ...], described("", "that explain it about as well; empty: it is sure")
    ]

    remainder: Annotated[
        bool, described("", "so weak beside another that it may be what linearising that leaves")
    ] = False

    @property
    def sure(self) -> bool:
        """Whether nothing else explains the same."""
        return not self.rivals and not self.remainder


@dataclass(frozen=True, eq=False)
class Attribution:
    """All tests of effects."""

    hypotheses: tuple[Hypothesis, ...]
    """The families that were tested."""
    effects: tuple[Effect, ...]
    """What was found, most significant first."""
    first: EffectTests
    last: EffectTests
    """Before any effect is taken as known, and with all of them."""
    found: Signature
    """Columns of all effects."""
    best_forces: tuple[PeriodicForce | None, ...]
    """The best-fitting position-periodic force of every strut, significant or not."""
    periodic_level: float
    """Of all scans together."""


def attribute(
    system: JointSystem,
    part: Linearisation,
    families: tuple[Hypothesis, ...],
    step: float,
    *,
    experiments: int = 1,
) -> Attribution:
    """Find the effects in the residuals of one experiment.

    Parameters
    ----------
    families : tuple of Hypothesis
        What is looked for beside forces that are periodic in a strut's length.
    step : float
        Between two samples, s.
    experiments : int
        How many share the level of the periodic forces; those of the families are their own.
    """
    search = Search(system, part, families, step, POSITION_PERIODIC / experiments)
    first = last = search.tests(())
    found: list[EffectCandidate] = []
    beside: list[EffectCandidate] = []  # what the last tests were made beside
    seen: set[frozenset[tuple[str, int | None, str]]] = set()
    while len(found) < _MOST:
        best = search.most_significant(last, found)
        if best is None:
            break
        found = search.significant([*found, best])
        names = frozenset(item.name for item in found)
        if names in seen:
            break
        seen.add(names)
        last, beside = search.tests(found), found
    found, rivals = search.exchange_for_rivals(found)
    if {id(item) for item in found} != {id(item) for item in beside}:
        last = search.tests(found) if found else first
    effects = _effects(search, found, rivals)
    known = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    best_forces = tuple(
        known[scan.strut] if scan.strut in known else _best_force(last.solved, part, scan)
        for scan in last.scans
    )
    columns = search.signature.picked(places_of(found))
    return Attribution(families, effects, first, last, columns, best_forces, search.level)


def _effects(
    search: Search,
    found: Sequence[EffectCandidate],
    rivals: Sequence[tuple[tuple[EffectCandidate, float], ...]],
) -> tuple[Effect, ...]:
    """Fit all effects together."""
    fit = search.projection.conditional_on(()).fit(places_of(found))
    effects, first = [], 0
    sizes = [search.conditional_statistic(item, without(found, item)) for item in found]
    for item, others, size in zip(found, rivals, sizes, strict=True):
        chosen = slice(first, first + len(item.places))
        first = chosen.stop
        values, covariance = fit.values[chosen], fit.covariance[chosen, chosen]
        stds = np.sqrt(np.diag(covariance))
        if item.sized_by_constant:
            values = np.array([item.constant])
        force, value, std = None, float(values[0]), float(stds[0])
        if item.kind == PERIODIC and item.strut is not None:
            force = periodic_force(search.part, item.strut, item.pitch, values, covariance)
            value, std = force.amplitude, force.amplitude_std
        log_p = search.conditional_log_p(item, without(found, item)) - item.limit
        level = _level(search, item.kind)
        effects.append(
            Effect(
                kind=item.kind,
                strut=item.strut,
                parameter=item.parameter,
                log_p=log_p + float(np.log(level)),
                force=force,
                value=value,
                std=std,
                values=values,
                stds=stds,
                constant=item.constant,
                remainder=size < REMAINDER * max(sizes),
                rivals=tuple(Rival(*rival.name, p) for rival, p in others),
            )
        )
    return tuple(effects)


def _level(search: Search, kind: str) -> float:
    if kind == PERIODIC:
        return search.level
    return next(hypothesis.level for hypothesis in search.families if hypothesis.kind == kind)


def _best_force(solved: SolvedSystem, part: Linearisation, scan: PitchScan) -> PeriodicForce | None:
    if not np.isfinite(scan.best_pitch) or scan.best <= 0:
        return None
    _, values, covariance = periodic_fit(solved, part, scan)
    return periodic_force(part, scan.strut, scan.best_pitch, values, covariance)


_NOT_PERIODIC = Assumption(
    "no position-periodic force",
    "a force is periodic in the strut's length",
    "compensate it in the drives, or add `cogging` with this `pitch` to the robot's `terms` (and "
    "`cogging_second` for half of it): it biases the parameters by more than their intervals show",
)
_PERIODIC_FORCE = "a position-periodic force"


def position_periodic_finding(attribution: Attribution) -> Finding:
    """Say whether forces are periodic in a strut's length."""
    level = attribution.periodic_level
    if not any(len(scan.pitches) for scan in attribution.first.scans):
        return _NOT_PERIODIC.skip(
            "no pitch could be scanned: the struts move too far between two samples"
        )
    effects = sorted(
        ((e.strut, e.force) for e in attribution.effects if e.strut is not None and e.force),
        key=lambda found: found[0],
    )
    if not effects:
        p = min(1.0, ACTUATORS * np.exp(min(scan.log_p for scan in attribution.last.scans)))
        sentence = f"no strut has a position-periodic force (p = {p:.2g})"
        return _NOT_PERIODIC.holds(sentence, p, level)
    where = name_channels("strut", np.isin(np.arange(ACTUATORS), [strut for strut, _ in effects]))
    forces = [
        f"strut {strut + 1} {force.amplitude:.3g} ± {force.amplitude_std:.1g} N, pitch "
        f"{1e3 * force.pitch:.4g} ± {1e3 * force.pitch_std:.1g} mm"
        for strut, force in effects
    ]
    own = [effect for effect in attribution.effects if effect.kind == PERIODIC]
    return _not_told_apart(
        attribution,
        own,
        _NOT_PERIODIC.fails(
            f"position-periodic force (cogging) in {where}: {'; '.join(forces)}",
            _effect_p(own, PERIODIC),
            level,
            where=where,
        ),
    )


def hypothesis_finding(attribution: Attribution, hypothesis: Hypothesis) -> Finding:
    """Say whether there is an effect of a family of causes."""
    assumption = hypothesis.assumption
    last = attribution.last.families[hypothesis.kind]
    effects = [effect for effect in attribution.effects if effect.kind == hypothesis.kind]
    if not attribution.first.families[hypothesis.kind].tested:
        return assumption.skip(hypothesis.reason_untested)
    if not effects:
        p, value, std = 1.0, 0.0, 0.0
        if last.tested:
            fit = attribution.last.beside.fit(last.places(last.best))
            p = min(1.0, last.tested * np.exp(last.log_p[last.best]))
            value = hypothesis.scale * fit.values[0]
            std = hypothesis.scale * float(np.sqrt(fit.covariance[0, 0]))
        return assumption.holds(
            hypothesis.absent.format(p=p, value=value, std=std), p, hypothesis.level
        )
    found = assumption.fails(
        "; ".join(_phrase(hypothesis, effect) for effect in effects),
        _effect_p(effects, hypothesis.kind),
        hypothesis.level,
        where=", ".join(dict.fromkeys(_place(effect) for effect in effects if _place(effect))),
    )
    return _not_told_apart(attribution, effects, found)


def _phrase(hypothesis: Hypothesis, effect: Effect) -> str:
    """Return what an effect is, where, and how large."""
    unit = hypothesis.unit(effect.parameter)
    numbers = [
        f"{hypothesis.scale * value:{hypothesis.number}} ± {hypothesis.scale * std:.1g}"
        for value, std in _sizes(effect, hypothesis)
    ][: hypothesis.values_shown]
    constant = f", velocity {effect.constant:g} m/s" if effect.kind == "stribeck" else ""
    size = f"{', '.join(numbers)} {unit}{constant}"
    rest = ", perhaps what the strongest effect leaves" * effect.remainder
    return f"{_named(effect.kind, [_place(effect)], {hypothesis.kind: hypothesis})} ({size}{rest})"


def _sizes(effect: Effect, hypothesis: Hypothesis) -> Iterator[tuple[float, float]]:
    """Yield what tells the size of an effect, with standard deviations: values, or amplitudes."""
    pairs = zip(effect.values.tolist(), effect.stds.tolist(), strict=True)
    if not hypothesis.paired:
        yield from pairs
        return
    for (sine, sine_std), (cosine, cosine_std) in zip(pairs, pairs, strict=True):
        amplitude = float(np.hypot(sine, cosine))
        yield amplitude, float(np.hypot(sine * sine_std, cosine * cosine_std)) / amplitude


def _place(effect: Effect | Rival) -> str:
    """Return where an effect is: ``p4 in actuator 3``, ``base joint 2``."""
    if effect.kind == "joint" and effect.strut is not None:
        return f"{effect.parameter} joint {effect.strut + 1}"
    number = "" if effect.strut is None else f"in actuator {effect.strut + 1}"
    return f"{effect.parameter} {number}".strip()


def _not_told_apart(attribution: Attribution, effects: Sequence[Effect], found: Finding) -> Finding:
    """Name what explains the same about as well, in sentence and verdict: all of it."""
    several = len(effects) > 1
    hypotheses = {hypothesis.kind: hypothesis for hypothesis in attribution.hypotheses}
    named = []
    for effect in effects:
        places: dict[str, list[str]] = {}
        for rival in effect.rivals:
            places.setdefault(rival.kind, []).append(_place(rival))
        if places:
            others = " or ".join(_named(kind, each, hypotheses) for kind, each in places.items())
            place = f"instead of {_named(effect.kind, [_place(effect)], hypotheses)} " * several
            named.append(f"{place}it may as well be {others}")
    if not named:
        return found
    return replace(
        found,
        sentence="; ".join((found.sentence, *named)),
        contradiction=f"{found.contradiction}, or something like it",
    )


def _named(kind: str, places: Sequence[str], hypotheses: Mapping[str, Hypothesis]) -> str:
    """Return what effects of one kind are, and where: ``a spring in actuator 1``."""
    hypothesis = hypotheses.get(kind)
    noun, form = (
        (_PERIODIC_FORCE, "{noun} {place}")
        if hypothesis is None
        else (hypothesis.noun, hypothesis.phrase)
    )
    everywhere = [noun] if "" in places else []
    somewhere = join_words([place for place in places if place])
    return join_words(
        [*everywhere, *([form.format(noun=noun, place=somewhere)] if somewhere else [])]
    )


def nouns_of(attribution: Attribution) -> dict[str, str]:
    """Return what effects are called, by their kind."""
    nouns = {PERIODIC: _PERIODIC_FORCE}
    return nouns | {
        hypothesis.kind: f"{hypothesis.noun} a parameter"
        if hypothesis.kind == "column"
        else hypothesis.noun
        for hypothesis in attribution.hypotheses
    }


def _effect_p(effects: Sequence[Effect], kind: str) -> float:
    """Return the smallest p of the effects of one kind: corrected for their family already."""
    return float(np.exp(min(effect.log_p for effect in effects if effect.kind == kind)))
