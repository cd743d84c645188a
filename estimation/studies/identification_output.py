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
from estimation.uncertainty.differences import FAMILY_LEVEL, holm
from expdesign.robot.graph import parameter_unit

_CLEAR = 3.0
"""Standard errors within which an estimate is at the truth."""

_RARE = 0.05


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


def _bias_claim(study: IdentificationStudy, result: CaseResult, estimator: str) -> Claim:
    bias, error = result.bias(estimator)
    t = np.abs(bias / error)[study.identified]
    std = np.abs(bias / result.reported_std(estimator))[study.identified]
    names = np.array(study.knowledge.names)[study.identified]
    outside = names[t > _CLEAR]
    worst = int(np.argmax(t))
    count = len(result.experiments)
    chance = len(names) * 2 * float(stats.t.sf(_CLEAR, count - 1))
    at_truth = estimator == "ml" or not result.case.disturbed
    value = (
        f"{len(outside)} of {len(names)} identified parameters are outside; worst {names[worst]}, "
        f"{t[worst]:.1f} standard errors ({std[worst]:.2g} standard deviations of one experiment)"
    )
    if at_truth:
        value += f"; by chance {chance:.2g} would be"
    statement = f"{result.case.key}, {estimator.upper()}: the mean of " + (
        f"{len(result.experiments)} estimates is within {_CLEAR:g} standard errors of the truth"
        if at_truth
        else f"{len(result.experiments)} estimates is biased"
    )
    p_values = holm(2 * stats.t.sf(t, count - 1))
    # A bias is one when it is no chance among so many parameters.
    holds = not len(outside) if at_truth else bool(np.min(p_values) < FAMILY_LEVEL)
    paper = ""
    if result.case.disturbed:
        paper = "unbiased" if estimator == "ml" else "biased by noise in the information matrix"
    # LS and GM without a disturbance are there to compare with.
    return Claim(
        statement, value, paper, holds if result.case.disturbed or estimator == "ml" else None
    )


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
