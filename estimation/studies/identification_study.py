"""LS, GM and ML against the truth, with and without what disturbs the information matrix.

The paper's Section V: where the motion enters the regressor with errors, estimates that take it as
it is are biased, and the estimate of motion and parameters together is not. Two disturbances:
pointwise differentiation, which puts the noise of the lengths into rates and accelerations; and
tracking error, which a motion with the design's harmonics does not hold.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, Knowledge, ParameterEstimate
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimate import parameter_knowledge
from estimation.montecarlo import StudyMonitor
from estimation.montecarlo.repetition import FAILURES
from estimation.studies.variants import TooFewEstimatesError, study_section, with_section
from estimation.studies.workers import results_of
from estimation.twin import Twin
from estimation.uncertainty.differences import FAMILY_LEVEL, hausman_test
from expdesign.configuration import RunConfiguration
from expdesign.experiment.scaling import parameter_scaling
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Job, Monitor

ESTIMATORS = ("ls", "gm", "ml")
_FEWEST = 3
IDENTIFIED = 0.5
"""Largest standard deviation, in units of its scale, of a parameter that counts as identified."""


@dataclass(frozen=True)
class Case:
    """How experiments are disturbed, and what LS and GM take for the motion.

    Attributes
    ----------
    key, title : str
    tracking_error : bool
    pointwise : bool
        LS and GM differentiate sample by sample.
    design_harmonics : bool
        LS and GM fit a motion with the design's harmonics.
    """

    key: str
    title: str
    tracking_error: bool = False
    pointwise: bool = False
    design_harmonics: bool = False

    @property
    def disturbed(self) -> bool:
        """True when the information matrix of LS and GM is."""
        return self.pointwise or self.design_harmonics


CASES = (
    Case("undisturbed", "motion fitted by its Fourier series"),
    Case("pointwise", "LS and GM with central differences", pointwise=True),
    Case(
        "tracking",
        "tracking error; LS and GM with the design's harmonics",
        tracking_error=True,
        design_harmonics=True,
    ),
)
"""ML always takes the Fourier series, with as many harmonics as the data show."""


@dataclass(frozen=True, eq=False)
class Hausman:
    """Whether GM and ML of one experiment differ.

    Attributes
    ----------
    z : (m,)
        Difference over its standard deviation; NaN where not judged.
    p_values : (m,)
        Corrected for their number.
    p_joint : float
    """

    z: Array
    p_values: Array
    p_joint: float

    @property
    def disturbed(self) -> bool:
        """The verdict: jointly, or by any parameter alone (half the level each)."""
        alone = np.nan_to_num(self.p_values, nan=1.0)
        return bool(self.p_joint < FAMILY_LEVEL / 2 or np.min(alone) < FAMILY_LEVEL / 2)


@dataclass(frozen=True, eq=False)
class Identification:
    """One experiment of one case.

    Attributes
    ----------
    values, std : dict of (m,)
        By estimator, SI.
    hausman : Hausman
    harmonics : int
        That ML found in the data.
    """

    values: Mapping[str, Array]
    std: Mapping[str, Array]
    hausman: Hausman
    harmonics: int


@dataclass(frozen=True, eq=False)
class CaseResult:
    """All experiments of one case.

    Attributes
    ----------
    case : Case
    truth : (m,)
    experiments : tuple of Identification
    failed : int
        Experiments that could not be estimated.
    """

    case: Case
    truth: Array
    experiments: tuple[Identification, ...]
    failed: int

    def errors(self, estimator: str) -> Array:
        """Return estimates minus truth, (K, m)."""
        return np.array([e.values[estimator] for e in self.experiments]) - self.truth

    def bias(self, estimator: str) -> tuple[Array, Array]:
        """Return the mean error and its standard error, (m,) each."""
        errors = self.errors(estimator)
        return errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(len(errors))

    def reported_std(self, estimator: str) -> Array:
        """Return the root mean square of the standard deviations stated, (m,)."""
        std = np.array([e.std[estimator] for e in self.experiments])
        return np.asarray(np.sqrt(np.mean(std**2, axis=0)))

    @cached_property
    def disturbed(self) -> int:
        """In how many experiments the Hausman test says so."""
        return sum(e.hausman.disturbed for e in self.experiments)


@dataclass(frozen=True, eq=False)
class IdentificationStudy:
    """All cases.

    Attributes
    ----------
    configuration : RunConfiguration
    robot : Robot
    knowledge : Knowledge
    cases : tuple of CaseResult
    seconds : float
    """

    configuration: RunConfiguration
    robot: Robot
    knowledge: Knowledge
    cases: tuple[CaseResult, ...]
    seconds: float

    @cached_property
    def identified(self) -> NDArray[np.bool_]:
        """Parameters that ML knows to less than half their scale in undisturbed data, (m,)."""
        scales = parameter_scaling(self.robot, "nominal")
        std = self.cases[0].reported_std("ml")
        return np.asarray(self.knowledge.free & (std < IDENTIFIED * scales))


def run_identification_study(
    configuration: RunConfiguration,
    design: FourierTrajectory,
    monitor: StudyMonitor | None = None,
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
    StudyInterruptedError
        A stop was requested.
    """
    began = time.perf_counter()
    section = study_section(configuration)
    build = partial(IdentificationBench, configuration, design)
    bench = build()
    jobs = [Job(_identified, (number,)) for number in range(1, section.repetitions + 1)]
    found = list(results_of(configuration, build, jobs, monitor, (0, len(jobs))))
    cases = []
    for case in CASES:
        done = [one[case.key] for one in found]
        kept = tuple(one for one in done if one is not None)
        if len(kept) < _FEWEST:
            raise TooFewEstimatesError(
                f"{case.key}: only {len(kept)} of {len(done)} experiments could be estimated"
            )
        cases.append(CaseResult(case, bench.truth, kept, len(done) - len(kept)))
    return IdentificationStudy(
        configuration,
        bench.robot,
        bench.knowledge,
        tuple(cases),
        time.perf_counter() - began,
    )


class IdentificationBench:
    """What all experiments share: the robot and the twins, built once per process.

    Parameters
    ----------
    configuration : RunConfiguration
    design : FourierTrajectory
    """

    def __init__(self, configuration: RunConfiguration, design: FourierTrajectory) -> None:
        self.configuration = with_section(configuration, "estimate", differentiation="fourier")
        self.design = design
        self.robot: Robot = robot_from(configuration.robot)
        self.knowledge = parameter_knowledge(configuration, self.robot)
        seed = configuration.run.montecarlo.seed
        clean = with_section(configuration, "experiment", tracking_error=None)
        tracking = with_section(
            configuration,
            "experiment",
            tracking_error=study_section(configuration).tracking_error,
        )
        self.twins = {
            False: Twin.of(clean, design, seed),
            True: Twin.of(tracking, design, seed),
        }
        self.truth: Array = self.twins[False].truth.parameter_vector

    def identify(self, number: int) -> dict[str, Identification | None]:
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
        try:
            estimates = {**own, **self._disturbed(case, data)}
        except FAILURES:
            return None
        ml, gm = estimates["ml"], estimates["gm"]
        share = ml.kinematic_share
        if fitted.fit is None or share is None:
            raise AssertionError("maximum likelihood has a motion")
        test = hausman_test(gm.values, ml.values, share)
        return Identification(
            {name: estimates[name].values for name in ESTIMATORS},
            {name: estimates[name].std for name in ESTIMATORS},
            Hausman(test.z, test.p_values, test.p_joint),
            fitted.fit.motion.harmonics,
        )

    def _disturbed(self, case: Case, data: Measurement) -> dict[str, ParameterEstimate]:
        """Return LS and GM with the motion that the case gives them."""
        if not case.disturbed:
            return {}
        changes = (
            {"differentiation": "central"}
            if case.pointwise
            else {"harmonics": self.design.harmonics}
        )
        configuration = with_section(self.configuration, "estimate", **changes)
        disturbed = prepare_experiment(configuration, self.robot, data, self.design)
        return run_estimators(self.robot, [disturbed], self.knowledge, ("ls", "gm"))


def _identified(
    bench: IdentificationBench, _monitor: Monitor, number: int
) -> dict[str, Identification | None]:
    return bench.identify(number)
