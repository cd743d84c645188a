"""What was found of the causes of residuals, in words, with what cannot be told apart from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimation.diagnostics.attribution import Attribution, Effect, Rival
from estimation.diagnostics.cause import Cause
from estimation.diagnostics.finding import Assumption, Finding, channels, listed
from estimation.diagnostics.record import ExperimentDiagnosis
from estimation.diagnostics.search import PERIODIC
from expdesign.mechanism.hexapod import ACTUATORS

_NOT_PERIODIC = Assumption(
    "no position-periodic force",
    "a force is periodic in the strut's length",
    "compensate it in the drives, or add `cogging` with this `pitch` to the robot's `terms` (and "
    "`cogging_second` for half of it): it biases the parameters by more than their intervals show",
)
_PERIODIC_FORCE = "a position-periodic force"


def position_periodic_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Say whether forces are periodic in a strut's length."""
    attribution = diagnosis.attribution
    level = attribution.periodic_level
    if not any(len(scan.pitches) for scan in attribution.first.scans):
        return _NOT_PERIODIC.untested(
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
    where = channels("strut", np.isin(np.arange(ACTUATORS), [strut for strut, _ in effects]))
    forces = [
        f"strut {strut + 1} {force.amplitude:.3g} ± {force.amplitude_std:.1g} N, pitch "
        f"{1e3 * force.pitch:.4g} ± {1e3 * force.pitch_std:.1g} mm"
        for strut, force in effects
    ]
    own = [effect for effect in attribution.effects if effect.kind == PERIODIC]
    return _not_told_apart(
        diagnosis,
        own,
        _NOT_PERIODIC.fails(
            f"position-periodic force (cogging) in {where}: {'; '.join(forces)}",
            _effect_p(own, PERIODIC),
            level,
            where=where,
        ),
    )


def cause_finding(diagnosis: ExperimentDiagnosis, cause: Cause) -> Finding:
    """Say whether there is an effect of a family of causes."""
    attribution, assumption = diagnosis.attribution, cause.assumption
    last = attribution.last.families[cause.kind]
    effects = [effect for effect in attribution.effects if effect.kind == cause.kind]
    if not attribution.first.families[cause.kind].tested:
        return assumption.untested(cause.untested)
    if not effects:
        p, value, std = 1.0, 0.0, 0.0
        if last.tested:
            fit = attribution.last.beside.fit(last.places(last.best))
            p = min(1.0, last.tested * np.exp(last.log_p[last.best]))
            value = cause.scale * fit.values[0]
            std = cause.scale * float(np.sqrt(fit.covariance[0, 0]))
        return assumption.holds(cause.absent.format(p=p, value=value, std=std), p, cause.level)
    found = assumption.fails(
        "; ".join(_phrase(cause, effect) for effect in effects),
        _effect_p(effects, cause.kind),
        cause.level,
        where=", ".join(dict.fromkeys(_place(effect) for effect in effects if _place(effect))),
    )
    return _not_told_apart(diagnosis, effects, found)


def _phrase(cause: Cause, effect: Effect) -> str:
    """Return what an effect is, where, and how large."""
    unit = cause.unit(effect.parameter)
    numbers = [
        f"{cause.scale * value:{cause.number}} ± {cause.scale * std:.1g}"
        for value, std in _sizes(effect, cause)
    ][: cause.shown]
    constant = f", velocity {effect.constant:g} m/s" if effect.kind == "stribeck" else ""
    size = f"{', '.join(numbers)} {unit}{constant}"
    rest = ", perhaps what the strongest effect leaves" * effect.remainder
    return f"{_named(effect.kind, [_place(effect)], {cause.kind: cause})} ({size}{rest})"


def _sizes(effect: Effect, cause: Cause) -> Iterator[tuple[float, float]]:
    """Yield what tells the size of an effect, with standard deviations: values, or amplitudes."""
    pairs = zip(effect.values.tolist(), effect.stds.tolist(), strict=True)
    if not cause.paired:
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


def _not_told_apart(
    diagnosis: ExperimentDiagnosis, effects: Sequence[Effect], found: Finding
) -> Finding:
    """Name what explains the same about as well, in sentence and verdict: all of it."""
    several = len(effects) > 1
    causes = {cause.kind: cause for cause in diagnosis.attribution.causes}
    named = []
    for effect in effects:
        places: dict[str, list[str]] = {}
        for rival in effect.rivals:
            places.setdefault(rival.kind, []).append(_place(rival))
        if places:
            others = " or ".join(_named(kind, each, causes) for kind, each in places.items())
            place = f"instead of {_named(effect.kind, [_place(effect)], causes)} " * several
            named.append(f"{place}it may as well be {others}")
    if not named:
        return found
    return replace(
        found,
        sentence="; ".join((found.sentence, *named)),
        contradiction=f"{found.contradiction}, or something like it",
    )


def _named(kind: str, places: Sequence[str], causes: Mapping[str, Cause]) -> str:
    """Return what effects of one kind are, and where: ``a spring in actuator 1``."""
    cause = causes.get(kind)
    noun, form = (_PERIODIC_FORCE, "{noun} {place}") if cause is None else (cause.noun, cause.named)
    everywhere = [noun] if "" in places else []
    somewhere = listed([place for place in places if place])
    return listed([*everywhere, *([form.format(noun=noun, place=somewhere)] if somewhere else [])])


def nouns_of(attribution: Attribution) -> dict[str, str]:
    """Return what effects are called, by their kind."""
    nouns = {PERIODIC: _PERIODIC_FORCE}
    return nouns | {
        cause.kind: f"{cause.noun} a parameter" if cause.kind == "column" else cause.noun
        for cause in attribution.causes
    }


def _effect_p(effects: Sequence[Effect], kind: str) -> float:
    """Return the smallest p of the effects of one kind: corrected for their family already."""
    return float(np.exp(min(effect.log_p for effect in effects if effect.kind == kind)))
