"""What the diagnostics say of the motion and of the noise."""

from __future__ import annotations

import numpy as np

from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.levels import CHI_SQUARE
from estimation.diagnostics.noise_tests import NoiseTests
from estimation.diagnostics.normality import Normality
from estimation.diagnostics.whiteness_finding import whiteness_finding
from estimation.diagnostics.wording import listed
from estimation.diagnostics.wording import struts as strut_list


def motion_findings(diagnosis: ExperimentDiagnosis) -> list[Finding]:
    """Tell whether the estimated motion explains the lengths."""
    name = "the Fourier series is the motion"
    test, white = diagnosis.length_chi_square, diagnosis.length_whiteness
    if test is None or white is None:
        return [
            Finding(
                name,
                Outcome.NOT_TESTED,
                "pointwise differentiation has no model of the motion; its error is in the "
                "regressor",
                "use `differentiation: fourier`",
            )
        ]
    advice = "allow more harmonics (`estimate.harmonics`), or look for drift and slipping sensors"
    ratio = f"χ² / degrees of freedom = {test.ratio:.3f}"
    findings = []
    if test.refused:
        findings.append(Finding(name, Outcome.NOT_TESTED, test.refused))
    elif test.p_value < CHI_SQUARE / 4:
        sentence = f"the length residuals are larger than the noise ({ratio})"
        findings.append(Finding(name, Outcome.FAILS, sentence, advice))
    elif test.p_smaller < CHI_SQUARE / 4:
        sentence = f"the length residuals are smaller than the noise ({ratio})"
        findings.append(
            Finding(name, Outcome.FAILS, sentence, "the noise of the lengths was given too large")
        )
    else:
        sentence = f"the length residuals have the size of the noise ({ratio})"
        findings.append(Finding(name, Outcome.HOLDS, sentence))
    findings.append(
        whiteness_finding(
            "what the motion leaves of the lengths is white",
            white,
            "strut",
            "the length residuals have no memory",
            "the length residuals are correlated in time",
            advice,
        )
    )
    return findings


def white_finding(diagnosis: NoiseTests) -> Finding:
    """Tell whether the noise has a memory."""
    name = "the noise is white"
    kinds = (
        ("actuator", diagnosis.force_noise_whiteness),
        ("strut", diagnosis.length_noise_whiteness),
    )
    tested = [(kind, test) for kind, test in kinds if test is not None]
    if not tested:
        return Finding(name, Outcome.NOT_TESTED, "no two periods can be compared sample by sample")
    failing = [
        ("forces of " if kind == "actuator" else "lengths of ")
        + strut_list(kind, np.flatnonzero(test.failed))
        for kind, test in tested
        if np.any(test.failed)
    ]
    largest = max(float(np.max(np.abs(test.autocorrelation))) for _, test in tested)
    if not failing:
        return Finding(
            name, Outcome.HOLDS, f"largest autocorrelation between periods {largest:.3f}"
        )
    return Finding(
        name,
        Outcome.FAILS,
        f"the noise is correlated in time ({listed(failing)}; up to {largest:.2f})",
        "a filter in the measurement? Sample more slowly or remove it: with correlated noise the "
        "standard deviations are too small",
    )


def outliers_finding(diagnosis: NoiseTests) -> Finding:
    """Tell whether there are outliers."""
    name = "no outliers"
    counts = []
    for kind, test in _normalities(diagnosis):
        counts += [
            f"{kind} {j + 1}: {test.outliers[j]}" for j in np.flatnonzero(test.with_outliers)
        ]
    if not counts:
        return Finding(name, Outcome.HOLDS, "no more samples are far off than in normal noise")
    return Finding(
        name,
        Outcome.FAILS,
        "more samples are far off than normal noise has (" + ", ".join(counts) + ")",
        "look at them, and estimate with the robust loss (`estimate.loss: huber`)",
    )


def normal_finding(diagnosis: NoiseTests) -> Finding:
    """Tell whether the noise is normal."""
    name = "the noise is normal"
    failing = [
        f"{kind} {j + 1} (skewness {test.skewness[j]:.2f}, excess kurtosis {test.kurtosis[j]:.2f})"
        for kind, test in _normalities(diagnosis)
        for j in np.flatnonzero(test.failed)
    ]
    if not failing:
        return Finding(name, Outcome.HOLDS, "skewness and kurtosis are those of normal noise")
    return Finding(
        name,
        Outcome.FAILS,
        "the noise is not normal: " + "; ".join(failing),
        "estimates stay unbiased and intervals hold for many samples; ML is no longer the most "
        "efficient estimator",
        serious=False,
    )


def constant_finding(diagnosis: NoiseTests) -> Finding:
    """Tell whether the periods differ."""
    name = "all periods are alike"
    failing = []
    for kind, test, factor, unit in (
        ("lengths of strut", diagnosis.length_drift, 1e3, "mm"),
        ("forces of actuator", diagnosis.force_drift, 1.0, "N"),
    ):
        if test is None or test.refused:
            continue
        failing += [
            f"{kind} {j + 1} by {factor * test.extent[j]:.2g} {unit}"
            for j in np.flatnonzero(test.failed)
        ]
    if diagnosis.force_drift.refused:
        return Finding(name, Outcome.NOT_TESTED, diagnosis.force_drift.refused)
    if not failing:
        return Finding(name, Outcome.HOLDS, "the means of the periods do not differ")
    return Finding(
        name,
        Outcome.FAILS,
        "period means change: " + ", ".join(failing),
        "let the machine warm up, or leave out the first periods: drift is counted as noise",
    )


def _normalities(diagnosis: NoiseTests) -> list[tuple[str, Normality]]:
    pairs = (
        ("force", diagnosis.force_normality),
        ("length", diagnosis.length_normality),
    )
    return [(kind, test) for kind, test in pairs if test is not None]
