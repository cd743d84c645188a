"""Measured against predicted forces on motions that were not used for the estimate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from estimation.data.measurement import Measurement
from estimation.data.reading import read_measurement
from estimation.diagnostics import Diagnosis, diagnose
from estimation.estimators import Experiment
from estimation.identification import prepare_experiment
from estimation.identification.record import SavedEstimate
from estimation.twin import Twin
from estimation.validation.motions import benchmark_motion
from expdesign.configuration import InputError, Problem, RunConfiguration, ValidationMotion
from expdesign.experiment.design import controller_period
from expdesign.recheck import Recheck, recheck
from expdesign.robot import LimitModel, Robot, robot_from
from expdesign.trajectory import FourierTrajectory

FIRST_REPETITION = 100_001
"""Number of the first motion's draw of noise: beyond those of any repetition of the experiment."""

_RECHECK_SAMPLES = 200


@dataclass(frozen=True, eq=False)
class MotionValidation:
    """The prediction of one motion.

    Attributes
    ----------
    name : str
        ``"circle"``, ``"circle, mirrored xz"``, the name of a file …
    simulated : bool
        Measured on the digital twin.
    trajectory : FourierTrajectory or None
        Of a computed motion.
    check : Recheck or None
        Its limits; a motion that breaks one is simulated nevertheless, with a warning.
    experiment : Experiment
    diagnosis : Diagnosis
        Of the prediction: held-out data.
    """

    name: str
    simulated: bool
    trajectory: FourierTrajectory | None
    check: Recheck | None
    experiment: Experiment
    diagnosis: Diagnosis


@dataclass(frozen=True, eq=False)
class ValidationResult:
    """All motions of a run."""

    configuration: RunConfiguration
    robot: Robot
    saved: SavedEstimate
    motions: tuple[MotionValidation, ...]
    seconds: float
    warnings: tuple[str, ...]

    @property
    def accepted(self) -> bool:
        """True when no motion speaks against the model."""
        return all(m.diagnosis.verdict.status.value == "accepted" for m in self.motions)


def validate(configuration: RunConfiguration, saved: SavedEstimate) -> ValidationResult:
    """Predict every motion of the run's `validate:` and judge the prediction.

    Computed motions are measured on the digital twin, with the disturbances of `experiment:`;
    recorded ones are read as `data:` says.

    Raises
    ------
    InputError
        The run names no motion, or one that cannot be made or read.
    """
    began = time.perf_counter()
    if not configuration.run.validation:
        raise InputError(
            Problem(
                "the run names no motion to validate on",
                file=configuration.file,
                key="validate",
                allowed="a list such as [{motion: circle}, {motion: circle, mirror: xz}]",
            )
        )
    robot = robot_from(configuration.robot)
    with threadpool_limits(limits=1, user_api="blas"):
        motions = tuple(
            _validated(configuration, robot, saved, number, motion)
            for number, motion in enumerate(configuration.run.validation)
        )
    return ValidationResult(
        configuration,
        robot,
        saved,
        motions,
        time.perf_counter() - began,
        (*configuration.warnings, *_warnings(saved, motions)),
    )


def _validated(
    configuration: RunConfiguration,
    robot: Robot,
    saved: SavedEstimate,
    number: int,
    motion: ValidationMotion,
) -> MotionValidation:
    trajectory: FourierTrajectory | None = None
    check: Recheck | None = None
    if motion.motion == "file":
        path = Path(str(motion.file))
        name = path.name
        data = read_measurement(path, configuration.run.data, configuration.robot)
    else:
        name = motion.motion
        try:
            trajectory = benchmark_motion(motion, robot.home, controller_period(configuration))
        except ValueError as error:
            raise InputError(
                Problem(str(error), file=configuration.file, key=f"validate[{number + 1}]")
            ) from error
        check = recheck(LimitModel.of(robot), trajectory, _RECHECK_SAMPLES)
        data = _simulated(configuration, trajectory, motion.periods, number)
    if motion.mirror != "none":
        name += f", mirrored {motion.mirror}"
    experiment = prepare_experiment(configuration, robot, data, trajectory)
    diagnosis = diagnose(robot, [experiment], saved.knowledge, saved.estimate, held_out=True)
    return MotionValidation(name, motion.motion != "file", trajectory, check, experiment, diagnosis)


def _simulated(
    configuration: RunConfiguration, trajectory: FourierTrajectory, periods: int, number: int
) -> Measurement:
    section = configuration.run.experiment.model_copy(update={"periods": periods})
    run = configuration.run.model_copy(update={"experiment": section})
    changed = RunConfiguration(run, configuration.robot, configuration.file)
    return Twin.of(changed, trajectory).measurement(FIRST_REPETITION + number)


def _warnings(saved: SavedEstimate, motions: Sequence[MotionValidation]) -> list[str]:
    found = []
    if saved.estimate.kinematic_share is None:
        found.append(
            "the estimate comes from pointwise differentiation: it is biased and its covariance "
            "too small, so that the tests may fail for the estimate's sake"
        )
    for motion in motions:
        if motion.check is not None and not motion.check.passed:
            worst = max(motion.check.limits, key=lambda limit: limit.violation)
            found.append(
                f"{motion.name}: the motion breaks {worst.key} ({worst.row}: {worst.value:.4g} "
                f"{worst.unit}, bound {worst.bound:.4g}); a real machine could not make it"
            )
    return found
