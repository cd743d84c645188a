"""LS, GM and ML with a disturbed information matrix: the paper's Section V.

Where the motion enters the regressor with errors, LS and GM are biased, and the joint estimate of
motion and parameters (ML) is not. Two disturbances are simulated: pointwise differentiation, which
amplifies the noise of the lengths in rates and accelerations, and a tracking error, which the
harmonics of the design do not describe. The Hausman test compares ML and GM.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import scipy

from constraints.arrays import Array, Mask
from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, ParameterEstimate, covariance_ml_less_gm
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimation import parameter_priors
from estimation.montecarlo.study import FAILURES
from estimation.twin import Twin
from estimation.uncertainty.intervals import FAMILY_LEVEL, Differences, difference_test
from examples.paper.setting import (
    Claim,
    Setting,
    StudyResult,
    completeness_claim,
    repeat,
    require_estimates,
)
from expdesign import FourierTrajectory
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.terms import parameter_unit
from expdesign.robot import robot_from

ESTIMATORS = ("ls", "gm", "ml")
_REPETITIONS = {False: 100, True: 4}
_TRACKING_ERROR = {"position": "1 mm", "angle": "0.1 deg", "harmonics": [6, 15]}
_RARE = 0.05
_WHOLE = 10.0
"""Larger numbers are shown without a decimal point."""


@dataclass(frozen=True)
class Case:
    """Simulation of the experiments, and the settings with which LS and GM are disturbed."""

    key: str
    title: str
    tracking_error: bool = False
    disturbed: bool = True


CASES = (
    Case("undisturbed", "motion fitted by its Fourier series", disturbed=False),
    Case("pointwise", "LS and GM with central differences"),
    Case("tracking", "tracking error; LS and GM with the design's harmonics", tracking_error=True),
)
"""ML always takes the Fourier series, with as many harmonics as the data show."""


@dataclass(frozen=True, eq=False)
class Identification:
    """Estimates (m,) of one experiment of one case by estimator, SI, and the Hausman test."""

    values: Mapping[str, Array]
    std: Mapping[str, Array]
    hausman: Differences
    harmonics: int

    @property
    def disturbed(self) -> bool:
        """Verdict of the Hausman test: jointly, or for any parameter (half the level each)."""
        alone = np.nan_to_num(self.hausman.p_values, nan=1.0)
        return bool(np.fmin(self.hausman.p_joint, np.min(alone)) < FAMILY_LEVEL / 2)


@dataclass(frozen=True, eq=False)
class CaseResult:
    """Experiments of one case that could be estimated, and the truth (m,)."""

    case: Case
    truth: Array
    experiments: tuple[Identification, ...]

    def bias(self, estimator: str) -> tuple[Array, Array]:
        """Return the mean error and its standard error, (m,) each."""
        errors = np.array([e.values[estimator] for e in self.experiments]) - self.truth
        return errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(len(errors))

    def reported_std(self, estimator: str) -> Array:
        """Return the root mean square of the standard deviations stated, (m,)."""
        std = np.array([e.std[estimator] for e in self.experiments])
        return np.asarray(np.sqrt(np.mean(std**2, axis=0)))

    @cached_property
    def disturbed(self) -> int:
        """Number of experiments that the Hausman test calls disturbed."""
        return sum(e.disturbed for e in self.experiments)


def study_identification(setting: Setting, design: FourierTrajectory) -> StudyResult:
    """Identify simulated experiments of every case, and test the estimators for a bias."""
    build = partial(IdentificationBench, setting, design)
    bench, count = build(), _REPETITIONS[setting.quick]
    found = repeat(setting, "identifications", build, count)
    cases = tuple(
        CaseResult(
            case, bench.truth, require_estimates(case.key, [one and one[case.key] for one in found])
        )
        for case in CASES
    )
    names, free = bench.knowledge.names, bench.knowledge.free
    identified = free & (cases[0].reported_std("ml") < IDENTIFIABLE * bench.robot.scales)
    claims = []
    for result in cases:
        claims += [bias_claim(result, estimator, names, identified) for estimator in ESTIMATORS]
        claims.append(_hausman_claim(result))
    kept = sum(len(result.experiments) for result in cases)
    claims.append(completeness_claim("experiment", kept, len(cases) * count))
    return StudyResult(
        "LS, GM and ML with a disturbed information matrix",
        tuple(claims),
        {
            "estimates": pd.DataFrame(_estimate_rows(cases, names, free, identified)),
            "hausman": pd.DataFrame(_hausman_rows(cases, names)),
        },
    )


class IdentificationBench:
    """Robot and twins that all experiments share, built once per process."""

    def __init__(self, setting: Setting, design: FourierTrajectory) -> None:
        self.configuration, self.design = setting.configuration(), design
        self.robot = robot_from(self.configuration.robot)
        self.knowledge = parameter_priors(self.configuration, self.robot)
        disturbed = setting.configuration(experiment={"tracking_error": _TRACKING_ERROR})
        seed = self.configuration.run.montecarlo.seed
        self.twins = {
            tracking: Twin.of(made, design, seed)
            for tracking, made in ((False, self.configuration), (True, disturbed))
        }
        self.truth: Array = self.twins[False].truth.values_of(self.robot.parameter_names)

    def repeat(self, number: int) -> dict[str, Identification | None]:
        """Return experiment `number` of every case; None where noise made an estimation fail."""
        found: dict[str, Identification | None] = dict.fromkeys(case.key for case in CASES)
        for tracking, twin in self.twins.items():
            data = twin.measurement(number)
            try:
                fitted = prepare_experiment(self.configuration, self.robot, data, self.design)
                estimates = run_estimators(self.robot, [fitted], self.knowledge, ESTIMATORS)
            except FAILURES:
                continue
            for case in CASES:
                if case.tracking_error is tracking:
                    found[case.key] = self._identify(case, data, fitted, estimates)
        return found

    def _identify(
        self,
        case: Case,
        data: Measurement,
        fitted: Experiment,
        undisturbed: dict[str, ParameterEstimate],
    ) -> Identification | None:
        """Replace LS and GM by estimates with the motion of a disturbed case."""
        changes: dict[str, dict[str, Any]] = {
            "pointwise": {"differentiation": "central"},
            "tracking": {"harmonics": self.design.harmonics},
        }
        estimates = dict(undisturbed)
        if case.disturbed:
            configuration = self.configuration.with_section("estimate", **changes[case.key])
            try:
                experiment = prepare_experiment(configuration, self.robot, data, self.design)
                estimates |= run_estimators(self.robot, [experiment], self.knowledge, ("ls", "gm"))
            except FAILURES:
                return None
        # The covariance that the difference has if nothing disturbs Gauss–Markov.
        covariance = covariance_ml_less_gm(undisturbed)
        if fitted.harmonics is None or covariance is None:
            raise AssertionError("maximum likelihood has a motion")
        values = (estimates["gm"].values, estimates["ml"].values)
        return Identification(
            {name: estimates[name].values for name in ESTIMATORS},
            {name: estimates[name].std for name in ESTIMATORS},
            difference_test(*values, covariance, undisturbed["ml"].covariance),
            fitted.harmonics,
        )


# --- claims ---------------------------------------------------------------------------------------


def bias_bound(parameters: int, experiments: int) -> float:
    """Return the standard errors beyond which a mean error is a bias, not chance.

    The standard error comes from the scatter of the same experiments, so that the ratio of a mean
    error to it has Student's t with K − 1 degrees of freedom where there is no bias. That any of
    the parameters is beyond the bound then has a probability of at most `FAMILY_LEVEL`, whatever
    their correlation (Bonferroni).

    >>> round(bias_bound(24, 100), 2)
    3.65
    """
    return float(scipy.stats.t.isf(FAMILY_LEVEL / (2 * parameters), experiments - 1))


def bias_claim(
    result: CaseResult, estimator: str, names: tuple[str, ...], identified: Mask
) -> Claim:
    """Return the verdict on the bias of one estimator in one case, as the paper expects it.

    Of the parameters `names`, (m,), those that are `identified`, (m,), are judged.
    """
    bias, error = result.bias(estimator)
    t = np.abs(bias / error)[identified]
    std = np.abs(bias / result.reported_std(estimator))[identified]
    judged = np.array(names)[identified]
    count = len(result.experiments)
    bound = bias_bound(len(judged), count)
    outside = int(np.count_nonzero(t > bound))
    worst = int(np.argmax(t))
    disturbed, ml = result.case.disturbed, estimator == "ml"
    unbiased = ml or not disturbed
    value = (
        f"{outside} of {len(judged)} identified parameters are beyond {bound:.3g} standard errors, "
        f"where chance alone puts any of them in at most {100 * FAMILY_LEVEL:g} % of such studies "
        f"(t, {count - 1} degrees of freedom); worst {judged[worst]}, {_number(t[worst])} standard "
        f"errors ({_number(std[worst])} of the standard deviations that {estimator.upper()} states "
        "for one experiment)"
    )
    statement = f"{result.case.key}, {estimator.upper()}: the mean of {count} estimates " + (
        "shows no bias" if unbiased else "is biased"
    )
    paper = "unbiased" if ml else "biased by noise in the information matrix"
    # LS and GM without a disturbance are there to compare with.
    holds = (not outside) == unbiased if disturbed or ml else None
    return Claim(statement, value, paper if disturbed else "", holds)


def _number(value: float) -> str:
    """Return a number with two digits or more, and no power of ten."""
    return f"{value:.0f}" if value >= _WHOLE else f"{value:.2g}"


def _hausman_claim(result: CaseResult) -> Claim:
    count = len(result.experiments)
    value = f"significant in {result.disturbed} of {count} experiments"
    if not result.case.disturbed:
        statement = "ML and GM take nearly the same motion, and hardly differ (Hausman)"
        return Claim(f"{result.case.key}: {statement}", value)
    return Claim(
        f"{result.case.key}: the difference of ML and GM (Hausman) shows the disturbance of the "
        "information matrix",
        value,
        holds=bool(result.disturbed / count > 1 - _RARE),
    )


# --- tables ---------------------------------------------------------------------------------------


def _estimate_rows(
    cases: tuple[CaseResult, ...], names: tuple[str, ...], free: Mask, identified: Mask
) -> Iterator[dict[str, Any]]:
    for result, estimator in product(cases, ESTIMATORS):
        bias, error = result.bias(estimator)
        reported = result.reported_std(estimator)
        first = result.experiments[0]
        tested = estimator == "ml"
        for k in np.flatnonzero(free):
            yield {
                "case": result.case.key,
                "estimator": estimator,
                "parameter": names[k],
                "unit": parameter_unit(names[k]),
                "truth": result.truth[k],
                "identified": bool(identified[k]),
                "value": first.values[estimator][k],
                "std": first.std[estimator][k],
                "mean": result.truth[k] + bias[k],
                "bias": bias[k],
                "bias_std_error": error[k],
                "bias_t": bias[k] / error[k],
                "bias_over_std": bias[k] / reported[k],
                "hausman_z": first.hausman.z[k] if tested else np.nan,
                "hausman_p": first.hausman.p_values[k] if tested else np.nan,
            }


def _hausman_rows(
    cases: tuple[CaseResult, ...], names: tuple[str, ...]
) -> Iterator[dict[str, Any]]:
    for result in cases:
        for number, experiment in enumerate(result.experiments, start=1):
            test = experiment.hausman
            sizes = np.nan_to_num(np.abs(test.z), nan=-1.0)
            worst = int(np.argmax(sizes))
            yield {
                "case": result.case.key,
                "experiment": number,
                "p_joint": test.p_joint,
                "largest_z": abs(test.z[worst]),
                # None of the differences may be large enough to be judged.
                "parameter": names[worst] if sizes[worst] >= 0 else "",
                "disturbed": experiment.disturbed,
                "harmonics": experiment.harmonics,
            }
