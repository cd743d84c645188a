"""Comparisons on the digital twin: of designs, of estimators, of tests."""

from __future__ import annotations

from estimation.identification.estimate import parameter_knowledge
from estimation.studies.design_study import DesignStudy
from estimation.studies.design_trials import refuse_unfit_design_study
from estimation.studies.identification_study import IdentificationStudy
from estimation.studies.study import Study, study_section
from estimation.studies.validation_runs import refuse_unfit_validation_study
from estimation.studies.validation_study import ValidationStudy
from expdesign.configuration import RunConfiguration
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor


def run_study(
    configuration: RunConfiguration,
    design: FourierTrajectory | None,
    monitor: Monitor | None = None,
) -> Study:
    """Do the study that a run names, with the errors of its kind's `run`.

    `design` is the motion that is executed; a study of designs makes its own.
    """
    kind = study_section(configuration).kind
    if kind == "design":
        return DesignStudy.run(configuration, monitor)
    if design is None:
        raise ValueError(f"a study of kind {kind} executes a design")
    if kind == "identification":
        return IdentificationStudy.run(configuration, design, monitor)
    return ValidationStudy.run(configuration, design, monitor)


def refuse_unfit_study(configuration: RunConfiguration, robot: Robot) -> None:
    """Refuse a study that could not be done, before anything is computed.

    Raises
    ------
    InputError
        Too few repetitions, parameters that the robot does not have, motions that cannot be.
    """
    kind = study_section(configuration).kind
    if kind == "design":
        refuse_unfit_design_study(configuration, robot)
        return
    parameter_knowledge(configuration, robot)
    if kind == "validation":
        refuse_unfit_validation_study(configuration, robot)
