"""Diagnostics as plain numbers, lists and texts for `estimate.json`; struts count from 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimation.diagnostics.attribution import Attribution, Effect
from estimation.diagnostics.chi_square import ChiSquare
from estimation.diagnostics.column_test import POWER, ColumnTest
from estimation.diagnostics.delay import DelayTest
from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.drift import Drift
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.lack_of_fit import LackOfFit
from estimation.diagnostics.noise_tests import NoiseTests
from estimation.diagnostics.normality import Normality
from estimation.diagnostics.position_periodic import PeriodicForce, PitchScan
from estimation.diagnostics.verdict import Verdict
from estimation.diagnostics.whiteness import Whiteness


def verdict_form(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict."""
    return {
        "status": verdict.status.value,
        "summary": verdict.summary,
        "findings": [finding_form(finding) for finding in verdict.findings],
    }


def experiment_form(diagnosis: ExperimentDiagnosis) -> dict[str, Any]:
    """Return the statistics of one experiment; residuals and other long arrays are left out."""
    return {
        "held_out": diagnosis.held_out,
        "chi_square": {
            "forces": _chi_square(diagnosis.force_chi_square),
            "forces_with_effects": _chi_square(diagnosis.force_chi_square_left),
            "lengths": _chi_square(diagnosis.length_chi_square),
        },
        "lack_of_fit": _lack_of_fit(diagnosis.lack_of_fit),
        "lack_of_fit_with_effects": _lack_of_fit(diagnosis.lack_of_fit_left),
        "variance_comparison": {
            "model_error": plain(diagnosis.variances.model_error),
            "measurement_error": plain(diagnosis.variances.measurement_error),
            "note": "information as in the paper, not a test: a residual contains the noise",
        },
        **_attribution(diagnosis.attribution),
        "whiteness": {
            **_noise_whiteness(diagnosis),
            "force_residuals": _whiteness(diagnosis.force_whiteness),
            "length_residuals": _whiteness(diagnosis.length_whiteness),
        },
        **_distribution(diagnosis),
    }


def finding_form(finding: Finding) -> dict[str, Any]:
    """Return one finding."""
    return {
        "assumption": finding.assumption,
        "outcome": finding.outcome.value,
        "sentence": finding.sentence,
        "advice": finding.advice,
        "serious": finding.serious,
    }


def noise_form(analysis: NoiseTests) -> dict[str, Any]:
    """Return the statistics of the noise by itself."""
    noise = analysis.noise
    return {
        "source": noise.source,
        "force_covariance": plain(noise.force_covariance),
        "length_covariance": plain(noise.length_covariance),
        "force_freedom": plain(noise.force_freedom),
        "length_freedom": plain(noise.length_freedom),
        "whiteness": _noise_whiteness(analysis),
        **_distribution(analysis),
    }


def _noise_whiteness(tests: NoiseTests) -> dict[str, Any]:
    return {
        "force_noise": _whiteness(tests.force_noise_whiteness),
        "length_noise": _whiteness(tests.length_noise_whiteness),
    }


def _distribution(tests: NoiseTests) -> dict[str, Any]:
    return {
        "normality": {
            "source": tests.samples.forces.source,
            "forces": _normality(tests.force_normality),
            "lengths": _normality(tests.length_normality),
        },
        "drift": {
            "forces": _drift(tests.force_drift),
            "lengths": _drift(tests.length_drift),
        },
    }


def plain(value: Any) -> Any:
    """Return arrays as lists and what is not finite as None."""
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _chi_square(test: ChiSquare | None) -> dict[str, Any] | None:
    if test is None:
        return None
    return {
        "value": plain(test.value),
        "degrees_of_freedom": plain(test.freedom),
        "ratio": plain(test.ratio),
        "p_larger": plain(test.p_value),
        "p_smaller": plain(test.p_smaller),
        "refused": test.refused,
    }


def _lack_of_fit(test: LackOfFit) -> dict[str, Any]:
    if test.refused:
        return {"refused": test.refused}
    return {
        "refused": "",
        "family_level": test.level,
        "samples": test.samples,
        "fitted_freedom": plain(test.fitted_freedom),
        "added_variance": plain(test.added_variance),
        "ms_lof": plain(test.mean_square),
        "ms_pe": plain(test.pure_error),
        "f": plain(test.statistic),
        "degrees_of_freedom": plain(test.statistic_freedom),
        "pure_error_degrees_of_freedom": plain(test.pure_error_freedom),
        "p": plain(test.p_values),
        "failed": _numbers(test.failed),
    }


def _attribution(attribution: Attribution) -> dict[str, Any]:
    return {
        "effects": [_effect(effect) for effect in attribution.effects],
        "position_periodic": [
            _scan(first, last, force)
            for first, last, force in zip(
                attribution.scans, attribution.last_scans, attribution.best_forces, strict=True
            )
        ],
        "columns": _columns(attribution.columns),
        "columns_with_effects": _columns(attribution.last_columns),
        "delay": _delay(attribution.delay),
        "delay_with_effects": _delay(attribution.last_delay),
    }


def _effect(effect: Effect) -> dict[str, Any]:
    return {
        "kind": effect.kind,
        "strut": None if effect.strut is None else effect.strut + 1,
        "parameter": effect.parameter,
        "log_p": plain(effect.log_p),
        "value": plain(effect.value),
        "std": plain(effect.std),
        "force": None if effect.force is None else _force(effect.force),
    }


def _force(force: PeriodicForce) -> dict[str, Any]:
    return {
        key: plain(getattr(force, key))
        for key in (
            "pitch",
            "pitch_std",
            "amplitude",
            "amplitude_std",
            "phase",
            "phase_std",
            "centre",
            "centre_phase",
            "centre_phase_std",
        )
    }


def _scan(first: PitchScan, last: PitchScan, force: PeriodicForce | None) -> dict[str, Any]:
    return {
        "strut": first.strut + 1,
        "pitches_scanned": len(first.pitches),
        "log_p": plain(first.log_p),
        "log_p_with_effects": plain(last.log_p),
        "best": None if force is None else _force(force),
    }


def _columns(test: ColumnTest) -> dict[str, Any]:
    detectable = test.detectable()
    return {
        "power": POWER,
        "family_level": test.level,
        "tested": test.tested,
        "columns": [
            {
                "parameter": name,
                "actuator": None if strut is None else strut + 1,
                "t": plain(test.statistic[k]),
                "log_p": plain(test.log_p[k]),
                "coefficient": plain(test.coefficients[k]),
                "std": plain(test.std[k]),
                "detectable": plain(detectable[k]),
                "failed": bool(test.failed[k]),
            }
            for k, (name, strut) in enumerate(test.labels)
        ],
    }


def _delay(test: DelayTest) -> dict[str, Any]:
    if test.refused:
        return {"refused": test.refused}
    return {
        "refused": "",
        "seconds": plain(test.delay),
        "std": plain(test.std),
        "log_p": plain(test.log_p),
        "failed": test.failed,
    }


def _whiteness(test: Whiteness | None) -> dict[str, Any] | None:
    if test is None:
        return None
    return {
        "family_level": test.level,
        "lags": test.lags,
        "autocorrelation": plain(test.autocorrelation),
        "statistic": plain(test.statistic),
        "p": plain(test.p_values),
        "failed": _numbers(test.failed),
    }


def _normality(test: Normality | None) -> dict[str, Any] | None:
    if test is None:
        return None
    return {
        "family_level": test.level,
        "samples": test.samples,
        "std": plain(test.std),
        "skewness": plain(test.skewness),
        "excess_kurtosis": plain(test.kurtosis),
        "statistic": plain(test.statistic),
        "p": plain(test.p_values),
        "failed": _numbers(test.failed),
        "outliers": plain(test.outliers),
        "outliers_expected": plain(test.outliers_expected),
        "outlier_p": plain(test.outlier_p_values),
    }


def _drift(test: Drift | None) -> dict[str, Any] | None:
    if test is None:
        return None
    if test.refused:
        return {"refused": test.refused}
    return {
        "refused": "",
        "family_level": test.level,
        "period_means": plain(test.means),
        "std_error": plain(test.std_error),
        "slope_per_period": plain(test.slope),
        "f": plain(test.statistic),
        "p": plain(test.p_values),
        "failed": _numbers(test.failed),
    }


def _numbers(flags: Any) -> list[int]:
    return [int(j) + 1 for j in np.flatnonzero(flags)]
