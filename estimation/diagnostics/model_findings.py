"""What the diagnostics say of the model of the forces."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from estimation.diagnostics.attribution import Effect
from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.levels import CHI_SQUARE
from estimation.diagnostics.whiteness_finding import whiteness_finding
from estimation.diagnostics.wording import struts as strut_list
from estimation.diagnostics.wording import verb
from expdesign.mechanism.catalogue import parameter_unit


def bias_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell which actuators have a bias, and what explains it."""
    test, left = diagnosis.lack_of_fit, diagnosis.lack_of_fit_left
    name = "the model explains the forces"
    if test.refused:
        return Finding(name, Outcome.NOT_TESTED, f"no bias test: {test.refused}")
    worst = int(np.nanargmin(test.p_values))
    if not np.any(test.failed):
        return Finding(
            name,
            Outcome.HOLDS,
            f"no actuator has a bias (largest F = {test.statistic[worst]:.3f} in actuator "
            f"{worst + 1}, p = {test.p_values[worst]:.2g})",
        )
    struts = np.flatnonzero(test.failed)
    sentence = (
        f"{strut_list('actuator', struts)} {verb(struts, 'has', 'have')} a bias (F = "
        + ", ".join(f"{test.statistic[j]:.3f}" for j in struts)
        + ")"
    )
    kinds = dict.fromkeys(e.kind for e in diagnosis.attribution.effects)
    if diagnosis.pointwise:
        advice = (
            "the residuals contain the noise of pointwise differentiation: use "
            "`differentiation: fourier` before blaming the model"
        )
    elif not kinds:
        advice = (
            "no position-periodic force, parameter or delay explains it: look at the residuals "
            "over position and speed for what the model lacks"
        )
    elif np.any(left.failed):
        rest = np.flatnonzero(left.failed)
        advice = (
            f"{_kinds(kinds)} explains a part; {strut_list('actuator', rest)} "
            f"{verb(rest, 'has', 'have')} more: look at the residuals over position and speed"
        )
    else:
        advice = f"{_kinds(kinds)} explains it: see below"
    return Finding(name, Outcome.FAILS, sentence, advice)


def position_periodic_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell which struts have a position-periodic force."""
    name = "no position-periodic force"
    effects = [e for e in diagnosis.attribution.effects if e.force is not None]
    scanned = [s.strut for s in diagnosis.attribution.scans if len(s.pitches)]
    if not scanned:
        return Finding(
            name,
            Outcome.NOT_TESTED,
            "no pitch could be scanned: the struts move too far between two samples",
        )
    if not effects:
        best = min(diagnosis.attribution.last_scans, key=lambda s: s.log_p)
        chance = min(1.0, 6 * np.exp(best.log_p))
        return Finding(
            name, Outcome.HOLDS, f"no strut has a position-periodic force (p = {chance:.2g})"
        )
    struts = np.array(sorted({_strut(e) for e in effects}))
    return Finding(
        name,
        Outcome.FAILS,
        f"position-periodic force (cogging) in {strut_list('strut', struts)}: "
        + "; ".join(_force(e) for e in sorted(effects, key=_strut)),
        "compensate it in the drives or add it to the model: it biases the parameters by more "
        "than their intervals tell",
    )


def _strut(effect: Effect) -> int:
    return -1 if effect.strut is None else effect.strut


def _force(effect: Effect) -> str:
    force = effect.force
    if force is None:
        raise AssertionError("a position-periodic effect has a force")
    return (
        f"strut {_strut(effect) + 1} {force.amplitude:.3g} ± {force.amplitude_std:.1g} N, pitch "
        f"{1e3 * force.pitch:.4g} ± {1e3 * force.pitch_std:.1g} mm"
    )


def columns_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell which parameters the residuals ask to change."""
    attribution = diagnosis.attribution
    effects = [e for e in attribution.effects if e.kind == "column"]
    name = "the parameters are right" if diagnosis.held_out else "one value fits all struts"
    if not attribution.columns.tested:
        return Finding(name, Outcome.NOT_TESTED, "no column of the regressor is left to test")
    if not effects:
        log_p = np.nanmin(attribution.last_columns.log_p)
        chance = min(1.0, attribution.last_columns.tested * np.exp(log_p))
        return Finding(
            name,
            Outcome.HOLDS,
            f"nothing of the residuals lies along the regressor's columns (p = {chance:.2g})",
        )
    parts = [
        e.parameter
        + (f" in actuator {e.strut + 1}" if e.strut is not None else "")
        + f" by {e.value:+.3g} ± {e.std:.1g} {parameter_unit(e.parameter)}"
        for e in effects
    ]
    advice = (
        "check these parameters against the machine, or identify them on a motion like this one"
        if diagnosis.held_out
        else "free what was fixed, or look for a fault in the struts named; the model has one "
        "value for all struts"
    )
    return Finding(
        name, Outcome.FAILS, "the residuals ask for a change of " + "; ".join(parts), advice
    )


def delay_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell whether the channels are aligned in time."""
    attribution = diagnosis.attribution
    name = "forces and lengths are sampled at the same time"
    if attribution.delay.refused:
        return Finding(name, Outcome.NOT_TESTED, attribution.delay.refused)
    effect = next((e for e in attribution.effects if e.kind == "delay"), None)
    if effect is None:
        last = attribution.last_delay
        return Finding(
            name,
            Outcome.HOLDS,
            f"the forces lag by {1e3 * last.delay:.3g} ± {1e3 * last.std:.1g} ms",
        )
    return Finding(
        name,
        Outcome.FAILS,
        f"the forces lag behind the lengths by {1e3 * effect.value:.3g} ± {1e3 * effect.std:.1g} "
        "ms",
        "give the delay in `data.delay` and estimate again",
    )


def left_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell whether anything is left in the mean residuals."""
    name = "what the model leaves of the forces is white"
    known = " besides the effects named" if diagnosis.attribution.effects else ""
    return whiteness_finding(
        name,
        diagnosis.force_whiteness,
        "actuator",
        f"the mean residual has no memory{known}",
        f"the mean residual is correlated in time{known}",
        "the model lacks something that changes slowly: look at the residuals over time",
    )


def noise_level_finding(diagnosis: ExperimentDiagnosis) -> Finding:
    """Tell whether the residuals have the size of the noise."""
    name = "the forces are as noisy as assumed"
    test = diagnosis.force_chi_square_left
    known = " besides the effects named" if diagnosis.attribution.effects else ""
    ratio = f"χ² / degrees of freedom = {test.ratio:.3f}{known}"
    if test.refused:
        return Finding(name, Outcome.NOT_TESTED, test.refused)
    if test.p_value < CHI_SQUARE / 4:
        return Finding(
            name,
            Outcome.FAILS,
            f"the force residuals are too large ({ratio})",
            "the model or the covariance of the noise is wrong; the bias test tells which",
        )
    if test.p_smaller < CHI_SQUARE / 4:
        return Finding(
            name,
            Outcome.FAILS,
            f"the force residuals are too small ({ratio})",
            "the noise was given too large: intervals are too wide",
        )
    return Finding(name, Outcome.HOLDS, f"the force residuals have the size of the noise ({ratio})")


def _kinds(kinds: Iterable[str]) -> str:
    words = {
        "position-periodic": "a position-periodic force",
        "column": "an error along the regressor's columns",
        "delay": "a delay between the channels",
    }
    return " with ".join(words[kind] for kind in kinds)
