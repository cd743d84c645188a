"""LS, GM and ML against the truth, with and without what disturbs the information matrix.

The paper's Section V: where the motion enters the regressor with errors, estimates that take it as
it is are biased, and the estimate of motion and parameters together is not. Two disturbances:
pointwise differentiation, which puts the noise of the lengths into rates and accelerations; and
tracking error, which a motion with the design's harmonics does not hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import Any

import numpy as np
import scipy

from constraints.arrays import Array, Mask
from estimation.data.measurement import Measurement
from estimation.estimators import (
    Experiment,
    Knowledge,
    ParameterEstimate,
    covariance_ml_less_gm,
)
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimate import parameter_knowledge
from estimation.montecarlo.repetition import FAILURES
from estimation.studies.records import ESTIMATES, HAUSMAN, Claim, EstimateRow, HausmanRow
from estimation.studies.study import (
    Study,
    TooFewEstimatesError,
    all_estimated,
    repeated,
    study_section,
)
from estimation.twin import Twin
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, difference_test
from expdesign.configuration import RunConfiguration
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.robot import Robot, robot_from
from expdesign.runfolder import RowTable
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor

_FEWEST = 3
_RARE = 0.05

_WHOLE = 10.0
"""From here on numbers are shown without a decimal point."""

ESTIMATORS = ("ls", "gm", "ml")


@dataclass(frozen=True)
class Case:
    """How experiments are made, and whether the information matrix of LS and GM is disturbed."""

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
    """One experiment of one case: estimates (m,) by estimator, SI, and what ML found."""

    values: Mapping[str, Array]
    std: Mapping[str, Array]
    hausman: Differences
    harmonics: int

    @property
    def disturbed(self) -> bool:
        """Hausman's verdict: jointly, or by any parameter alone (half the level each)."""
        alone = np.nan_to_num(self.hausman.p_values, nan=1.0)
        return bool(np.fmin(self.hausman.p_joint, np.min(alone)) < FAMILY_LEVEL / 2)


@dataclass(frozen=True, eq=False)
class CaseResult:
    """All experiments of one case but those that `failed` to be estimated; the truth is (m,)."""

    case: Case
    truth: Array
    experiments: tuple[Identification, ...]
    failed: int

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
        """In how many experiments the Hausman test says so."""
        return sum(e.disturbed for e in self.experiments)


class IdentificationBench:
    """What all experiments share: the robot and the twins, built once per process."""

    def __init__(self, configuration: RunConfiguration, design: FourierTrajectory) -> None:
        self.configuration = configuration.with_section("estimate", differentiation="fourier")
        self.design = design
        self.robot: Robot = robot_from(configuration.robot)
        self.knowledge = parameter_knowledge(configuration, self.robot)
        seed = configuration.run.montecarlo.seed
        errors = {False: None, True: study_section(configuration).tracking_error}
        self.twins = {
            tracking: Twin.of(
                configuration.with_section("experiment", tracking_error=error), design, seed
            )
            for tracking, error in errors.items()
        }
        self.truth: Array = self.twins[False].truth.values_of(self.robot.parameter_names)

    def repeat(self, number: int) -> dict[str, Identification | None]:
        """Return experiment `number` of every case; None where noise let an estimate fail."""
        found: dict[str, Identification | None] = dict.fromkeys(case.key for case in CASES)
        for tracking, twin in self.twins.items():
            data = twin.measurement(number)
            try:
                fitted = prepare_experiment(self.configuration, self.robot, data, self.design)
                own = run_estimators(self.robot, [fitted], self.knowledge, ESTIMATORS)
            except FAILURES:
                continue
            for case in CASES:
                if case.tracking_error is tracking:
                    found[case.key] = self._case(case, data, fitted, own)
        return found

    def _case(
        self,
        case: Case,
        data: Measurement,
        fitted: Experiment,
        own: dict[str, ParameterEstimate],
    ) -> Identification | None:
        # What LS and GM take for the motion.
        changes: dict[str, dict[str, Any]] = {
            "pointwise": {"differentiation": "central"},
            "tracking": {"harmonics": self.design.harmonics},
        }
        estimates = dict(own)
        if case.disturbed:
            configuration = self.configuration.with_section("estimate", **changes[case.key])
            try:
                experiment = prepare_experiment(configuration, self.robot, data, self.design)
                estimates |= run_estimators(self.robot, [experiment], self.knowledge, ("ls", "gm"))
            except FAILURES:
                return None
        # What the difference is if nothing disturbs Gauss–Markov.
        covariance = covariance_ml_less_gm(own)
        if fitted.harmonics is None or covariance is None:
            raise AssertionError("maximum likelihood has a motion")
        values = (estimates["gm"].values, estimates["ml"].values)
        return Identification(
            {name: estimates[name].values for name in ESTIMATORS},
            {name: estimates[name].std for name in ESTIMATORS},
            difference_test(*values, covariance, own["ml"].covariance),
            fitted.harmonics,
        )


@dataclass(frozen=True, eq=False)
class IdentificationStudy(Study):
    """All cases."""

    knowledge: Knowledge
    cases: tuple[CaseResult, ...]

    @classmethod
    def run(
        cls,
        configuration: RunConfiguration,
        design: FourierTrajectory,
        monitor: Monitor | None = None,
    ) -> IdentificationStudy:
        """Identify many simulated experiments of every case.

        Raises
        ------
        InputError
            The run cannot be simulated or estimated.
        UnidentifiableError
            The experiment does not determine every free parameter.
        TooFewEstimatesError
            Fewer than three experiments of a case could be estimated.
        StoppedError
            A stop was requested.
        """
        build = partial(IdentificationBench, configuration, design)
        bench = build()
        found = repeated(configuration, build, monitor)
        cases = []
        for case in CASES:
            done = [one and one[case.key] for one in found]
            kept = tuple(one for one in done if one is not None)
            if len(kept) < _FEWEST:
                raise TooFewEstimatesError(
                    f"{case.key}: only {len(kept)} of {len(done)} experiments could be estimated"
                )
            cases.append(CaseResult(case, bench.truth, kept, len(done) - len(kept)))
        return cls(configuration, bench.robot, bench.knowledge, tuple(cases))

    @cached_property
    def identified(self) -> Mask:
        """Parameters that ML knows to less than half their scale in undisturbed data, (m,)."""
        scales = self.robot.scales
        std = self.cases[0].reported_std("ml")
        return np.asarray(self.knowledge.free & (std < IDENTIFIABLE * scales))

    def claims(self) -> Iterator[Claim]:
        """Yield what the study was to show."""
        for result in self.cases:
            for estimator in ESTIMATORS:
                yield bias_claim(result, estimator, self.knowledge.names, self.identified)
            yield _hausman_claim(result)
        failed = sum(result.failed for result in self.cases)
        total = failed + sum(len(result.experiments) for result in self.cases)
        yield all_estimated("experiment", total, failed)

    def rows(self) -> dict[RowTable[Any], Iterable[Any]]:
        """Return the rows of every table."""
        return {ESTIMATES: self._estimates(), HAUSMAN: self._hausman()}

    def _estimates(self) -> Iterator[EstimateRow]:
        for result, estimator in product(self.cases, ESTIMATORS):
            bias, error = result.bias(estimator)
            reported = result.reported_std(estimator)
            first = result.experiments[0]
            tested = estimator == "ml"
            for k in np.flatnonzero(self.knowledge.free):
                name = self.knowledge.names[k]
                yield EstimateRow(
                    result.case.key,
                    estimator,
                    name,
                    parameter_unit(name),
                    truth=result.truth[k],
                    identified=bool(self.identified[k]),
                    value=first.values[estimator][k],
                    std=first.std[estimator][k],
                    mean=result.truth[k] + bias[k],
                    bias=bias[k],
                    bias_std_error=error[k],
                    bias_t=bias[k] / error[k],
                    bias_over_std=bias[k] / reported[k],
                    hausman_z=first.hausman.z[k] if tested else np.nan,
                    hausman_p=first.hausman.p_values[k] if tested else np.nan,
                )

    def _hausman(self) -> Iterator[HausmanRow]:
        for result in self.cases:
            for number, experiment in enumerate(result.experiments, start=1):
                test = experiment.hausman
                sizes = np.nan_to_num(np.abs(test.z), nan=-1.0)
                worst = int(np.argmax(sizes))
                # None of the differences may be large enough to be judged.
                name = self.knowledge.names[worst] if sizes[worst] >= 0 else ""
                found = (test.p_joint, abs(test.z[worst]), name)
                disturbed = "yes" if experiment.disturbed else "no"
                yield HausmanRow(result.case.key, number, *found, disturbed, experiment.harmonics)


def bias_bound(parameters: int, experiments: int) -> float:
    """Return the standard errors beyond which a mean error is a bias, not chance.

    The standard error comes from the scatter of the same experiments, so that the ratio of a mean
    error to it has Student's t with K − 1 degrees of freedom where there is no bias. That any of
    the parameters is beyond the bound then has a probability of at most `FAMILY_LEVEL`, whatever
    their correlation (Bonferroni).
    """
    return float(scipy.stats.t.isf(FAMILY_LEVEL / (2 * parameters), experiments - 1))


def bias_claim(
    result: CaseResult, estimator: str, names: tuple[str, ...], identified: Mask
) -> Claim:
    """Return whether an estimator has a bias in one case, and whether it should.

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
    value = f"says so in {result.disturbed} of {count} experiments"
    if not result.case.disturbed:
        statement = "ML and GM take nearly the same motion, and hardly differ"
        return Claim(f"{result.case.key}: {statement}", value)
    return Claim(
        f"{result.case.key}: the difference of ML and GM (Hausman) says that the information "
        "matrix is disturbed",
        value,
        holds=bool(result.disturbed / count > 1 - _RARE),
    )
