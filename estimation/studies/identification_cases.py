"""Simulated experiments identified with and without what disturbs the information matrix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, ParameterEstimate
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimate import parameter_knowledge
from estimation.montecarlo.repetition import FAILURES
from estimation.studies.study import study_section, with_section
from estimation.twin import Twin
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, hausman_test
from expdesign.configuration import RunConfiguration
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory

ESTIMATORS = ("ls", "gm", "ml")


@dataclass(frozen=True)
class Case:
    """How experiments are disturbed, and what LS and GM take for the motion.

    Attributes
    ----------
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
class Identification:
    """One experiment of one case.

    Attributes
    ----------
    values, std : dict of (m,)
        By estimator, SI.
    hausman : Differences
        Of GM and ML.
    harmonics : int
        That ML found in the data.
    """

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
    """All experiments of one case.

    Attributes
    ----------
    truth : (m,)
    failed : int
        Experiments that could not be estimated.
    """

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
        self.configuration = with_section(configuration, "estimate", differentiation="fourier")
        self.design = design
        self.robot: Robot = robot_from(configuration.robot)
        self.knowledge = parameter_knowledge(configuration, self.robot)
        seed = configuration.run.montecarlo.seed
        errors = {False: None, True: study_section(configuration).tracking_error}
        self.twins = {
            tracking: Twin.of(
                with_section(configuration, "experiment", tracking_error=error), design, seed
            )
            for tracking, error in errors.items()
        }
        self.truth: Array = self.twins[False].truth.parameter_vector

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
        try:
            estimates = {**own, **self._disturbed(case, data)}
        except FAILURES:
            return None
        ml, gm = estimates["ml"], estimates["gm"]
        share = ml.kinematic_share
        if fitted.fit is None or share is None:
            raise AssertionError("maximum likelihood has a motion")
        return Identification(
            {name: estimates[name].values for name in ESTIMATORS},
            {name: estimates[name].std for name in ESTIMATORS},
            hausman_test(gm.values, ml.values, share),
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
