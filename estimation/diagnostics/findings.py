"""What the tests of one experiment found, assumption by assumption, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.attribution import PERIODIC, Attribution, Effect, Rival
from estimation.diagnostics.cause import Cause
from estimation.diagnostics.channel_test import CHI_SQUARE
from estimation.diagnostics.finding import Assumption, Finding
from estimation.diagnostics.lack_of_fit import ChiSquare
from estimation.diagnostics.noise_tests import NoiseTests, Whiteness
from estimation.diagnostics.record import ExperimentDiagnosis, ExperimentTests
from expdesign.mechanism.hexapod import ACTUATORS

_MOST_RIVALS = 3
"""That are named in a sentence."""

_OfNoise = NoiseTests | ExperimentTests
"""What has tests of the noise by itself."""

_EXPLAINED = Assumption(
    "the model explains the forces",
    "the model does not explain the forces",
    "look at the residuals over position and speed for what the model lacks",
)
_NOT_PERIODIC = Assumption(
    "no position-periodic force",
    "a force is periodic in the strut's length",
    "compensate it in the drives or add it to the model: it biases the parameters by more than "
    "their intervals show",
)
_RESIDUALS_WHITE = Assumption(
    "what the model leaves of the forces is white",
    "the mean force residuals are correlated in time",
    "the model lacks something that changes slowly: look at the residuals over time",
)
_NOISE_LEVEL = Assumption(
    "the forces are as noisy as assumed",
    "the force residuals do not have the size of the noise",
    "the model or the covariance of the noise is wrong; the bias test tells which",
)
_MOTION = Assumption(
    "the Fourier series is the motion",
    "the fitted motion does not explain the lengths",
    "allow more harmonics (`estimate.harmonics`), or look for drift and slipping sensors",
)
_LENGTHS_WHITE = Assumption(
    "what the motion leaves of the lengths is white",
    "the length residuals are correlated in time",
    _MOTION.advice,
)
_NOISE_WHITE = Assumption(
    "the noise is white",
    "the noise is correlated in time",
    "a filter in the measurement? Sample more slowly or remove it: with correlated noise the "
    "standard deviations are too small",
)
_NOISE_WHITE_OR_COUNTED = Assumption(
    "the noise is white",
    "the noise is correlated in time",
    "nothing: the standard deviations count it",
    serious=False,
)
_NO_OUTLIERS = Assumption(
    "no outliers",
    "there are outliers",
    "look at them, and estimate with the robust loss (`estimate.loss: huber`)",
)
_NORMAL = Assumption(
    "the noise is normal",
    "the noise is not normal",
    "estimates stay unbiased and intervals hold for many samples; ML is no longer the most "
    "efficient estimator",
    serious=False,
)
_ALIKE = Assumption(
    "all periods are alike",
    "the periods differ from each other",
    "let the machine warm up, or leave out the first periods: drift is counted as noise",
)
_GAINS_STAY = Assumption(
    "the gains of the forces stay the same",
    "the gain of a force drifts during the recording",
    "let the drives warm up (a motor constant falls with the temperature), or record less; a mean "
    "gain that is wrong has its tolerance, `tolerances.force_constant`",
)


_NOTICEABLE_RATIO = 1.1
"""Of a standard deviation to that of white noise: what is less is of no consequence."""


def experiment_findings(diagnosis: ExperimentDiagnosis) -> list[Finding]:
    """Return what was found of every assumption."""
    tests, white = diagnosis.tests, diagnosis.tests.whiteness.force_residuals
    if white is None:
        raise AssertionError("forces leave residuals")
    left = "besides the effects named" if diagnosis.attribution.effects else ""
    return [
        _bias(diagnosis),
        _position_periodic(diagnosis),
        *(_cause(diagnosis, cause) for cause in diagnosis.attribution.causes),
        _gain_drift(tests),
        _white(_RESIDUALS_WHITE, white, "actuator", "mean residual", left),
        _size(_NOISE_LEVEL, tests.chi_square.forces_with_effects, "force", left),
        *_motion(tests),
        *noise_findings(tests),
    ]


def noise_findings(tests: _OfNoise) -> tuple[Finding, ...]:
    """Return what was found of the noise by itself."""
    return _noise_white(tests), *_distribution(tests), _periods(tests)


def _bias(diagnosis: ExperimentDiagnosis) -> Finding:
    """Which actuators have a bias, and what explains it."""
    test, left = diagnosis.tests.lack_of_fit, diagnosis.tests.lack_of_fit_with_effects
    if test.refused:
        return _EXPLAINED.untested(f"no bias test: {test.refused}")
    p = _family_p(test.p_values)
    worst = int(np.nanargmin(test.p_values))
    if not np.any(test.failed):
        sentence = (
            f"no actuator has a bias (largest F = {test.statistic[worst]:.3f} in actuator "
            f"{worst + 1}, p = {test.p_values[worst]:.2g})"
        )
        return _EXPLAINED.holds(sentence, p, test.level)
    where = _channels("actuator", test.failed)
    values = ", ".join(f"{value:.3f}" for value in test.statistic[test.failed])
    words = _nouns(diagnosis.attribution)
    found = " with ".join(dict.fromkeys(words[e.kind] for e in diagnosis.attribution.effects))
    if diagnosis.pointwise:
        advice = (
            "the residuals contain the noise of pointwise differentiation: use "
            "`differentiation: fourier` before blaming the model"
        )
    elif not found:
        advice = f"no effect that was looked for explains it: {_EXPLAINED.advice}"
    elif np.any(left.failed):
        rest = _channels("actuator", left.failed)
        advice = f"{found} explains a part; there is more in {rest}: {_EXPLAINED.advice}"
    else:
        advice = f"{found} explains it: see below"
    return _EXPLAINED.fails(f"a bias in {where} (F = {values})", p, test.level, where, advice)


def _position_periodic(diagnosis: ExperimentDiagnosis) -> Finding:
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
    where = _channels("strut", np.isin(np.arange(ACTUATORS), [strut for strut, _ in effects]))
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


def _cause(diagnosis: ExperimentDiagnosis, cause: Cause) -> Finding:
    """Whether there is an effect of a family of causes."""
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
        for value, std in zip(effect.values, effect.stds, strict=True)
    ][: cause.shown]
    where = _place(effect)
    constant = f", velocity {effect.constant:g} m/s" if effect.kind == "stribeck" else ""
    size = f"{', '.join(numbers)} {unit}{constant}"
    return f"{cause.noun}{' ' * bool(where)}{where} ({size})"


def _place(effect: Effect | Rival) -> str:
    """Return where an effect is: ``p4 in actuator 3``, ``base joint 2``."""
    if effect.kind == "joint" and effect.strut is not None:
        return f"{effect.parameter} joint {effect.strut + 1}"
    number = "" if effect.strut is None else f"in actuator {effect.strut + 1}"
    return f"{effect.parameter} {number}".strip()


def _not_told_apart(
    diagnosis: ExperimentDiagnosis, effects: Sequence[Effect], found: Finding
) -> Finding:
    """Name what explains the same about as well, in sentence and verdict."""
    nouns = _nouns(diagnosis.attribution)
    named = []
    for effect in effects:
        shown = [f"{nouns[r.kind]} {_place(r)}".strip() for r in effect.rivals]
        if shown:
            listed = _listed(shown[:_MOST_RIVALS])
            more = f" and {len(shown) - _MOST_RIVALS} more" * (len(shown) > _MOST_RIVALS)
            named.append(f"{nouns[effect.kind]} {_place(effect)}".strip() + f": {listed}{more}")
    if not named:
        return found
    return replace(
        found,
        sentence=f"{found.sentence}; not told apart from others that explain it about as well "
        f"({'; '.join(named)})",
        contradiction=f"{found.contradiction}, or something like it",
    )


def _nouns(attribution: Attribution) -> dict[str, str]:
    """Return what effects are called, by their kind."""
    nouns = {PERIODIC: "a position-periodic force"}
    return nouns | {cause.kind: cause.noun for cause in attribution.causes}


def _gain_drift(tests: ExperimentTests) -> Finding:
    """Whether gains drift from period to period."""
    test = tests.gain_drift
    if test.refused:
        return _GAINS_STAY.untested(test.refused)
    p = float(np.exp(test.log_p))
    where = [
        "all actuators" if each.actuator is None else f"actuator {each.actuator + 1}"
        for each in test.found
    ]
    changes = [
        f"{place} by {100 * each.change:+.2g} ± {100 * each.std:.1g} %"
        for place, each in zip(where, test.found, strict=True)
    ]
    return _GAINS_STAY.judged(
        ", ".join(where),
        f"no gain drifts (p = {p:.2g})",
        f"gains drift from the first period to the last: {'; '.join(changes)}",
        p,
        test.level,
    )


def _motion(tests: ExperimentTests) -> list[Finding]:
    """Whether the estimated motion explains the lengths."""
    test, white = tests.chi_square.lengths, tests.whiteness.length_residuals
    if test is None or white is None:
        reason = "pointwise differentiation has no model of the motion; its error is in the "
        return [_MOTION.untested(reason + "regressor", "use `differentiation: fourier`")]
    return [
        _size(_MOTION, test, "length"),
        _white(_LENGTHS_WHITE, white, "strut", "length residuals"),
    ]


def _size(assumption: Assumption, test: ChiSquare, kind: str, left: str = "") -> Finding:
    """Whether residuals are as large as the noise."""
    if test.refused:
        return assumption.untested(test.refused)
    p = min(1.0, 4 * min(test.p_value, test.p_smaller))
    ratio = f"(χ² / degrees of freedom = {test.ratio:.3f}{' ' * bool(left)}{left})"
    if p >= CHI_SQUARE:
        sentence = f"the {kind} residuals have the size of the noise {ratio}"
        return assumption.holds(sentence, p, CHI_SQUARE)
    small = test.p_smaller < test.p_value
    sentence = f"the {kind} residuals are too {'small' if small else 'large'} {ratio}"
    advice = f"the noise of the {kind}s was given too large: intervals are too wide"
    return assumption.fails(sentence, p, CHI_SQUARE, advice=advice if small else "")


def _white(
    assumption: Assumption, test: Whiteness, kind: str, what: str, left: str = ""
) -> Finding:
    """Whether what was left by a fit is correlated in time."""
    p = _family_p(test.p_values)
    verb = "are" if what.endswith("s") else "is"
    known = " " * bool(left) + left
    worst = float(np.max(np.abs(test.autocorrelation)))
    where = _channels(kind, test.failed)
    return assumption.judged(
        where,
        f"the {what} {verb} not correlated in time to an extent that matters{known} (largest "
        f"autocorrelation {worst:.3f})",
        f"the {what} {verb} correlated in time{known} in {where}",
        p,
        test.level,
    )


def _noise_white(tests: _OfNoise) -> Finding:
    white = tests.whiteness
    kinds = {"forces of actuator": white.force_noise, "lengths of strut": white.length_noise}
    done = {kind: test for kind, test in kinds.items() if test is not None}
    if not done:
        return _NOISE_WHITE.untested("no two periods can be compared sample by sample")
    p = min(_family_p(test.p_values) for test in done.values())
    level = next(iter(done.values())).level
    largest = max(float(np.max(np.abs(test.autocorrelation))) for test in done.values())
    where = _listed([_channels(kind, test.failed) for kind, test in done.items()])
    absent = f"largest autocorrelation between periods {largest:.3f}"
    present = f"the noise is correlated in time ({where}; up to {largest:.2f})"
    if not white.counted:
        return _NOISE_WHITE.judged(where, absent, present, p, level)
    # What matters is what the correlation does to the parameters.
    ratio = f"standard deviations up to {white.std_ratio:.2g} times those of white noise"
    if white.std_ratio_p < level and white.std_ratio > _NOTICEABLE_RATIO:
        where = where or white.std_ratio_of
        p = min(p, white.std_ratio_p)
    if white.std_ratio_of:
        absent, present = f"{absent}, {ratio}", f"{present}, {ratio} ({white.std_ratio_of})"
    return _NOISE_WHITE_OR_COUNTED.judged(where, absent, present, p, level)


def _distribution(tests: _OfNoise) -> Iterator[Finding]:
    """Yield whether there are outliers, and whether the noise is normal."""
    kinds = {"force": tests.normality.forces, "length": tests.normality.lengths}
    done = {kind: test for kind, test in kinds.items() if test is not None}
    level = tests.normality.forces.level
    p = min(_family_p(test.outlier_p_values) for test in done.values())
    outliers = {
        f"{kind} {j + 1}": f"{test.outliers[j]}"
        for kind, test in done.items()
        for j in np.flatnonzero(test.with_outliers)
    }
    counts = ", ".join(f"{channel}: {count}" for channel, count in outliers.items())
    absent = "no more samples are far off than in normal noise"
    present = f"more samples are far off than normal noise has ({counts})"
    yield _NO_OUTLIERS.judged(", ".join(outliers), absent, present, p, level)
    p = min(_family_p(test.p_values) for test in done.values())
    shapes = {
        f"{kind} {j + 1}": f"skewness {test.skewness[j]:.2f}, excess kurtosis "
        f"{test.kurtosis[j]:.2f}"
        for kind, test in done.items()
        for j in np.flatnonzero(test.failed)
    }
    numbers = "; ".join(f"{channel} ({shape})" for channel, shape in shapes.items())
    absent = "skewness and kurtosis are those of normal noise"
    present = f"the noise is not normal: {numbers}"
    yield _NORMAL.judged(", ".join(shapes), absent, present, p, level)


def _periods(tests: _OfNoise) -> Finding:
    """Whether the means of the periods differ."""
    force = tests.drift.forces
    if force.refused:
        return _ALIKE.untested(force.refused)
    changes, p = {}, 1.0
    for kind, test, factor, unit in (
        ("lengths of strut", tests.drift.lengths, 1e3, "mm"),
        ("forces of actuator", force, 1.0, "N"),
    ):
        if test is None or test.refused:
            continue
        p = min(p, _family_p(test.p_values))
        for j in np.flatnonzero(test.failed):
            changes[f"{kind} {j + 1}"] = f"by {factor * test.extent[j]:.2g} {unit}"
    listed = ", ".join(f"{channel} {change}" for channel, change in changes.items())
    absent, present = "the means of the periods do not differ", f"period means change: {listed}"
    return _ALIKE.judged(", ".join(changes), absent, present, p, force.level)


def _family_p(p_values: Array) -> float:
    """Return the smallest p of one family, corrected for its size."""
    return float(min(1.0, len(p_values) * np.nanmin(p_values)))


def _effect_p(effects: Sequence[Effect], kind: str) -> float:
    """Return the smallest p of the effects of one kind: corrected for their family already."""
    return float(np.exp(min(effect.log_p for effect in effects if effect.kind == kind)))


def _channels(kind: str, flags: NDArray[np.bool_]) -> str:
    """Return ``"struts 3 and 4"`` for the channels with these flags, (6,); empty for none."""
    numbers = [str(j + 1) for j in np.flatnonzero(flags)]
    return f"{kind}{'s' * (len(numbers) > 1)} {_listed(numbers)}" if numbers else ""


def _listed(words: Iterable[str]) -> str:
    """Return ``"a, b and c"`` of the words that are not empty."""
    *first, last = [word for word in words if word] or [""]
    return f"{', '.join(first)} and {last}" if first else last
