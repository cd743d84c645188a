"""What repeated validations show: their tables and claims."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from estimation.studies.claim import Claim
from estimation.studies.share import Share
from estimation.studies.tables import TABLES
from estimation.studies.validation_study import SITUATIONS, ValidationStudy
from estimation.studies.variants import study_section

_WANTED = 0.95
"""Share of the runs in which a verdict must be right: 38 of 40."""

_POWER = 0.8
_PAPER = "992.0 and 594.1 N² against 883.0 and 371.9 N² of noise"
_TITLES = {
    "without": "no cogging",
    "unknown": "cogging that the model does not know",
    "known": "cogging in the identification too",
}


def validation_tables(study: ValidationStudy) -> dict[str, pd.DataFrame]:
    """Return the tables by name."""
    rows = {
        "study_variances": _variances(study),
        "study_power": _power(study),
        "study_verdicts": _verdicts(study),
    }
    return {
        name: pd.DataFrame(list(found), columns=[column.name for column in TABLES[name]])
        for name, found in rows.items()
    }


def validation_claims(study: ValidationStudy) -> list[Claim]:
    """Return what the study was to show."""
    found = [
        _verdict_claim(study, situation, number)
        for situation in SITUATIONS
        for number in range(len(study.motions))
    ]
    struts = np.flatnonzero(study.expected("unknown"))
    for number, motion in enumerate(study.motions):
        model, noise = _mean_variances(study, "unknown", number)
        found.append(
            Claim(
                f"{motion}: variance about the prediction of actuators "
                f"{_listed(struts)} with cogging that the model does not know",
                " and ".join(f"{model[j]:.1f}" for j in struts)
                + " N² against "
                + " and ".join(f"{noise[j]:.1f}" for j in struts)
                + " N² of noise",
                _PAPER if list(struts) == [2, 3] else "",
            )
        )
    for situation in ("without", "unknown"):
        share = study.everywhere_as_expected(situation)
        found.append(
            Claim(
                f"{_TITLES[situation]}: the verdict is right on all motions of a run",
                _of(share),
                holds=share.hits >= _WANTED * share.trials,
            )
        )
    total = len(study.runs) + study.failed
    every = Claim(
        "every run can be estimated", f"{len(study.runs)} of {total}", holds=not study.failed
    )
    return [*found, _power_claim(study), every]


def _verdict_claim(study: ValidationStudy, situation: str, number: int) -> Claim:
    share = study.as_expected(situation, number)
    motion = study.motions[number]
    if situation == "known":
        failing = [
            j
            for j in range(6)
            if np.mean([run.situations["known"][number].failed[j] for run in study.runs]) > 0.5  # noqa: PLR2004
        ]
        return Claim(
            f"{_TITLES[situation]}, {motion}: reported, not judged",
            f"actuators that fail in most runs: {_listed(failing)}",
        )
    wanted = study.expected(situation)
    statement = (
        f"exactly actuators {_listed(np.flatnonzero(wanted))} fail"
        if np.any(wanted)
        else "all actuators pass"
    )
    return Claim(
        f"{_TITLES[situation]}, {motion}: {statement}",
        _of(share),
        "actuators 3 and 4 fail" if np.any(wanted) else "",
        holds=share.hits >= _WANTED * share.trials,
    )


def _power_claim(study: ValidationStudy) -> Claim:
    wrong = study_section(study.configuration).wrong
    shares = {name: study.power(name) for name in wrong}
    weak = [name for name, share in shares.items() if share.hits < _POWER * share.trials]
    seen = {test for name in wrong for test, _ in study.tests_against(name)}
    value = f"{len(wrong) - len(weak)} of {len(wrong)} parameters"
    if seen:
        value += "; tests that fail: " + ", ".join(f"'{test}'" for test in sorted(seen))
    if weak:
        told = ", ".join(f"{name} ({_of(shares[name])})" for name in weak)
        value += f"; the power is below {100 * _POWER:.0f} % for {told}"
    factors = ", ".join(f"{name} by {factor:g}" for name, factor in wrong.items())
    return Claim(
        f"a parameter that is wrong on purpose ({factors}; one at a time) fails a test in at least "
        f"{100 * _POWER:.0f} % of the runs",
        value,
    )


def _of(share: Share) -> str:
    return (
        f"{share.hits} of {share.trials} runs (95 %: {100 * share.low:.0f} … "
        f"{100 * share.high:.0f} %)"
    )


def _listed(places: Any) -> str:
    return " and ".join(str(j + 1) for j in places) or "none"


def _mean_variances(
    study: ValidationStudy, situation: str, number: int
) -> tuple[np.ndarray, np.ndarray]:
    found = [run.situations[situation][number] for run in study.runs]
    return (
        np.mean([one.variance_model_error for one in found], axis=0),
        np.mean([one.variance_measurement_error for one in found], axis=0),
    )


def _variances(study: ValidationStudy) -> Iterator[dict[str, Any]]:
    for situation in SITUATIONS:
        for number, motion in enumerate(study.motions):
            model, noise = _mean_variances(study, situation, number)
            fails = np.sum([run.situations[situation][number].failed for run in study.runs], axis=0)
            for j in range(6):
                yield {
                    "situation": situation,
                    "motion": motion,
                    "actuator": j + 1,
                    "variance_model_error": model[j],
                    "variance_measurement_error": noise[j],
                    "fails": int(fails[j]),
                    "runs": len(study.runs),
                }


def _verdicts(study: ValidationStudy) -> Iterator[dict[str, Any]]:
    for run, found in enumerate(study.runs, start=1):
        for situation in SITUATIONS:
            for motion, one in zip(study.motions, found.situations[situation], strict=True):
                yield {
                    "run": run,
                    "situation": situation,
                    "motion": motion,
                    **{f"fails_{j + 1}": bool(one.failed[j]) for j in range(6)},
                    "against": "; ".join(one.against),
                }


def _power(study: ValidationStudy) -> Iterator[dict[str, Any]]:
    for name, factor in study_section(study.configuration).wrong.items():
        share = study.power(name)
        yield {
            "parameter": name,
            "factor": factor,
            "seen": share.hits,
            "runs": share.trials,
            "power": share.hits / share.trials,
            "low": share.low,
            "high": share.high,
            "tests": "; ".join(f"{test}: {count}" for test, count in study.tests_against(name)),
        }
