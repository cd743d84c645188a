"""What a comparison of estimators shows: its tables and claims."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from estimation.studies.claim import Claim
from estimation.studies.identification_study import (
    ESTIMATORS,
    CaseResult,
    IdentificationStudy,
)
from estimation.studies.tables import TABLES
from estimation.uncertainty.differences import FAMILY_LEVEL
from expdesign.mechanism.catalogue import parameter_unit

_RARE = 0.05

_WHOLE = 10.0
"""From here on numbers are told without a decimal point."""


def identification_tables(study: IdentificationStudy) -> dict[str, pd.DataFrame]:
    """Return the tables by name."""
    rows = {"study_estimates": _estimates(study), "study_hausman": _hausman(study)}
    return {
        name: pd.DataFrame(list(found), columns=[column.name for column in TABLES[name]])
        for name, found in rows.items()
    }


def identification_claims(study: IdentificationStudy) -> list[Claim]:
    """Return what the study was to show."""
    found: list[Claim] = []
    for result in study.cases:
        found += [_bias_claim(study, result, name) for name in ESTIMATORS]
        found.append(_hausman_claim(result))
    failed = sum(result.failed for result in study.cases)
    total = failed + sum(len(result.experiments) for result in study.cases)
    found.append(
        Claim("every experiment can be estimated", f"{total - failed} of {total}", holds=not failed)
    )
    return found


def bias_bound(parameters: int, experiments: int) -> float:
    """Return the standard errors beyond which a mean error is a bias, not chance.

    The standard error comes from the scatter of the same experiments, so that the ratio of a mean
    error to it has Student's t with K − 1 degrees of freedom where there is no bias. That any of
    the parameters is beyond the bound then has a probability of at most `FAMILY_LEVEL`, whatever
    their correlation (Bonferroni).
    """
    return float(stats.t.isf(FAMILY_LEVEL / (2 * parameters), experiments - 1))


def _bias_claim(study: IdentificationStudy, result: CaseResult, estimator: str) -> Claim:
    bias, error = result.bias(estimator)
    t = np.abs(bias / error)[study.identified]
    std = np.abs(bias / result.reported_std(estimator))[study.identified]
    names = np.array(study.knowledge.names)[study.identified]
    count = len(result.experiments)
    bound = bias_bound(len(names), count)
    outside = int(np.count_nonzero(t > bound))
    worst = int(np.argmax(t))
    unbiased = estimator == "ml" or not result.case.disturbed
    value = (
        f"{outside} of {len(names)} identified parameters are beyond {bound:.3g} standard errors, "
        f"where chance alone puts any of them in at most {100 * FAMILY_LEVEL:g} % of such studies "
        f"(t, {count - 1} degrees of freedom); worst {names[worst]}, {_number(t[worst])} standard "
        f"errors ({_number(std[worst])} of the standard deviations that {estimator.upper()} states "
        "for one experiment)"
    )
    statement = f"{result.case.key}, {estimator.upper()}: the mean of {count} estimates " + (
        "shows no bias" if unbiased else "is biased"
    )
    paper = ""
    if result.case.disturbed:
        paper = "unbiased" if estimator == "ml" else "biased by noise in the information matrix"
    # LS and GM without a disturbance are there to compare with.
    judged = result.case.disturbed or estimator == "ml"
    return Claim(statement, value, paper, (not outside) == unbiased if judged else None)


def _number(value: float) -> str:
    """Return a number with two digits or more, and no power of ten."""
    return f"{value:.0f}" if value >= _WHOLE else f"{value:.2g}"


def _hausman_claim(result: CaseResult) -> Claim:
    count = len(result.experiments)
    share = result.disturbed / count
    wanted = result.case.disturbed
    if not wanted:
        return Claim(
            f"{result.case.key}: ML and GM take nearly the same motion, and hardly differ",
            f"'disturbed: yes' in {result.disturbed} of {count} experiments",
        )
    return Claim(
        f"{result.case.key}: the difference of ML and GM (Hausman) says that the information "
        "matrix is disturbed",
        f"'disturbed: yes' in {result.disturbed} of {count} experiments",
        holds=bool(share > 1 - _RARE),
    )


def _estimates(study: IdentificationStudy) -> Iterator[dict[str, Any]]:
    for result in study.cases:
        for estimator in ESTIMATORS:
            bias, error = result.bias(estimator)
            reported = result.reported_std(estimator)
            first = result.experiments[0]
            for k, name in enumerate(study.knowledge.names):
                if not study.knowledge.free[k]:
                    continue
                yield {
                    "case": result.case.key,
                    "estimator": estimator,
                    "parameter": name,
                    "unit": parameter_unit(name),
                    "truth": result.truth[k],
                    "identified": bool(study.identified[k]),
                    "value": first.values[estimator][k],
                    "std": first.std[estimator][k],
                    "mean": result.truth[k] + bias[k],
                    "bias": bias[k],
                    "bias_std_error": error[k],
                    "bias_t": bias[k] / error[k],
                    "bias_over_std": bias[k] / reported[k],
                    "hausman_z": first.hausman.z[k] if estimator == "ml" else np.nan,
                    "hausman_p": first.hausman.p_values[k] if estimator == "ml" else np.nan,
                }


def _hausman(study: IdentificationStudy) -> Iterator[dict[str, Any]]:
    for result in study.cases:
        for number, experiment in enumerate(result.experiments, start=1):
            test = experiment.hausman
            worst = int(np.nanargmax(np.abs(test.z)))
            yield {
                "case": result.case.key,
                "experiment": number,
                "p_joint": test.p_joint,
                "largest_z": abs(test.z[worst]),
                "parameter": study.knowledge.names[worst],
                "disturbed": "yes" if test.disturbed else "no",
                "harmonics": experiment.harmonics,
            }
