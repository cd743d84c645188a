"""What no study can be done with, found before anything is computed."""

from __future__ import annotations

from estimation.identification.estimate import parameter_knowledge
from estimation.studies.design_study import refuse_unfit_design_study
from estimation.studies.validation_study import refuse_unfit_validation_study
from estimation.studies.variants import study_section
from expdesign.configuration import RunConfiguration
from expdesign.robot import Robot


def refuse_unfit_study(configuration: RunConfiguration, robot: Robot) -> None:
    """Refuse a study that could not be done, whatever came before it.

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
