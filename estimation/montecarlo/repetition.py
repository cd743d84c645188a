"""One repetition of a study: an experiment on the twin and the estimates from its recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import ConfigDict

from constraints.arrays import Array
from estimation.diagnostics.noise_result import Freedom
from estimation.estimators import (
    Experiment,
    ParameterEstimate,
    ParameterPriors,
    cramer_rao_covariance,
)
from estimation.identification.estimated_machine import linearise_at_load
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.noise_choice import with_stated_spectrum
from estimation.identification.periods import UnsuitableDataError
from estimation.identification.recording import prepare_experiment
from estimation.kinematics.fourier_fit import MotionFit
from estimation.measurement_model import HarmonicMotion
from estimation.processing import (
    NoiseEstimate,
    NoiseModel,
    PeriodicRecording,
    PeriodSource,
    fold_recording,
)
from estimation.twin import Twin
from estimation.twin.disturbances import NoiseSource
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import ComputationError, RunConfiguration
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot, robot_from
from expdesign.runfolder import Numbers, described
from expdesign.trajectory import FourierTrajectory

NUMERICAL_FAILURES = (ComputationError, ArithmeticError, np.linalg.LinAlgError)
"""Failures due to noise: no pose, no motion, a singular information matrix."""

FAILURES = (*NUMERICAL_FAILURES, UnsuitableDataError)
"""Failures of one recording that the next one need not have."""


@dataclass(frozen=True, eq=False)
class RepetitionEstimate:
    """Estimate of one estimator in one repetition."""

    values: Annotated[Numbers | None, described("SI", "(m,) estimates; null when it failed")] = None
    std: Annotated[Numbers | None, described("SI", "(m,) as stated; null when it failed")] = None
    widths: Annotated[
        Numbers | None, described("1", "(m,) half widths of the 95 % intervals, in std")
    ] = None
    converged: Annotated[bool, described("", "the iteration ended as it should")] = False
    iterations: Annotated[int, described("1", "number of iterations")] = 0
    error: Annotated[str, described("", "why it failed; empty when it did not")] = ""


@dataclass(frozen=True, eq=False)
class Repetition:
    """Estimates of one repetition: a line of the journal."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    number: Annotated[int, described("1", "from 1")]
    harmonics: Annotated[
        int | None, described("1", "of the motion that ML estimates; null where there is none")
    ]
    freedom: Annotated[
        Freedom,
        described("1", "degrees of freedom behind the noise covariance; null when given"),
    ]
    outcomes: Annotated[dict[str, RepetitionEstimate], described("", "by estimator")]


@dataclass(frozen=True, eq=False)
class Workbench:
    """Twin and model that all repetitions share; built once per process."""

    configuration: RunConfiguration
    robot: Robot
    priors: ParameterPriors
    design: FourierTrajectory
    twin: Twin

    @classmethod
    def of(cls, configuration: RunConfiguration, design: FourierTrajectory) -> Workbench:
        """Build it.

        Raises
        ------
        InputError
            The run cannot be simulated, or fixes every parameter.
        """
        robot = robot_from(configuration.robot)
        priors = parameter_priors(configuration, robot)
        twin = Twin.of(configuration, design, configuration.run.montecarlo.seed)
        return cls(configuration, robot, priors, design, twin)

    def repeat(self, number: int) -> Repetition:
        """Simulate and estimate a repetition; only the noise depends on its number.

        A failed estimate states its reason in the result. Invalid input raises.
        """
        wanted = self.configuration.run.montecarlo.estimators
        try:
            experiment = prepare_experiment(
                self.configuration, self.robot, self.twin.measurement(number), self.design
            )
        except FAILURES as error:
            failed = RepetitionEstimate(error=_reason(error))
            return Repetition(number, None, np.inf, dict.fromkeys(wanted, failed))
        return Repetition(
            number,
            experiment.harmonics,
            experiment.noise.forces.freedom,
            self._outcomes(experiment, wanted),
        )

    def bound(self) -> Array:
        """Return the Cramér–Rao bound as a covariance, (m, m), SI; zero for fixed parameters.

        At the true parameters along the executed motion, whose harmonics are the kinematic
        unknowns, with the true noise, the exact signs of dry friction, and all samples of the
        experiment. A prior counts as data. The model is that of the run's robot, whatever machine
        is measured. Noise with a spectrum counts line by line where a period is a whole number of
        samples, and for white elsewhere.

        Raises
        ------
        UnidentifiableError
            The experiment does not determine every free parameter.
        """
        twin, truth = self.twin, self.twin.truth
        free_frequency = self.configuration.run.estimate.frequency == "estimated"
        measured = twin.recorded(twin.lengths, twin.forces)
        record = fold_recording(
            measured, truth.executed.omega, PeriodSource.DESIGN, average=not free_frequency
        )
        motion = HarmonicMotion.of(truth.executed, free_frequency=free_frequency)
        # The motion is known here: nothing of the fit but the motion itself is used.
        known = MotionFit(
            motion=motion,
            covariance=np.zeros((motion.unknowns, motion.unknowns)),
            residuals=np.zeros((record.samples, ACTUATORS)),
        )
        noise = NoiseModel(
            _known_noise(twin.force_noise, record), _known_noise(twin.length_noise, record)
        )
        values = truth.values_of(self.robot.parameter_names)
        robot = self.robot.with_load_at(values)
        spread = np.zeros((record.samples, robot.graph.signs.numel()))
        experiment = Experiment.along(robot, record, noise, known, spread)
        return cramer_rao_covariance(robot, [experiment], [motion], self.priors, values)

    def _outcomes(
        self, experiment: Experiment, wanted: tuple[str, ...]
    ) -> dict[str, RepetitionEstimate]:
        try:
            robot, experiments = linearise_at_load(self.robot, [experiment], self.priors)
            found = run_estimators(robot, experiments, self.priors, wanted)
        except NUMERICAL_FAILURES as error:
            if len(wanted) == 1:
                return {wanted[0]: RepetitionEstimate(error=_reason(error))}
            # One by one, to keep those that did not fail.
            return {name: self._outcomes(experiment, (name,))[name] for name in wanted}
        return {name: _outcome(found[name]) for name in wanted}


def _known_noise(source: NoiseSource, record: PeriodicRecording) -> NoiseEstimate:
    plain = NoiseEstimate(source.covariance, np.inf, "given")
    if source.spectrum is None or not record.averaged:
        return plain
    return with_stated_spectrum(plain, source.spectrum, record)


def _outcome(estimate: ParameterEstimate) -> RepetitionEstimate:
    if not (np.all(np.isfinite(estimate.values)) and np.all(np.isfinite(estimate.std))):
        return RepetitionEstimate(
            error="the estimate is not finite", iterations=estimate.iterations
        )
    return RepetitionEstimate(
        estimate.values,
        estimate.std,
        interval_widths(estimate.freedom),
        estimate.converged,
        estimate.iterations,
    )


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
