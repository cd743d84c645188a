"""Optimal experiment design and identification for hexapods.

`load_robot` gives the model, `load_measurement` a recording. `design`, `simulate`, `estimate` and
`report` are the stages that are called most; `run` does all that a run file names.
"""

from typing import TYPE_CHECKING

from expdesign.loading import names_loaded_when_used

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from expdesign.configuration import InputError, load_run
    from expdesign.experiment import DesignResult, design
    from expdesign.robot import Robot, load_robot
    from expdesign.stages.run import RunResult, estimate, load_measurement, report, run, simulate
    from expdesign.stages.workspace import Progress, StageFailed
    from expdesign.trajectory import FourierTrajectory

__all__ = [
    "DesignResult",
    "FourierTrajectory",
    "InputError",
    "Measurement",
    "Progress",
    "Robot",
    "RunResult",
    "StageFailed",
    "design",
    "estimate",
    "load_measurement",
    "load_robot",
    "load_run",
    "report",
    "run",
    "simulate",
]

_HOMES = {
    "InputError": "expdesign.configuration",
    "DesignResult": "expdesign.experiment",
    "Measurement": "estimation.data.measurement",
    "FourierTrajectory": "expdesign.trajectory",
    "Robot": "expdesign.robot",
    "design": "expdesign.experiment",
    "load_robot": "expdesign.robot",
    "load_run": "expdesign.configuration",
    "Progress": "expdesign.stages.workspace",
    "StageFailed": "expdesign.stages.workspace",
    **dict.fromkeys(
        ("RunResult", "estimate", "load_measurement", "report", "run", "simulate"),
        "expdesign.stages.run",
    ),
}

# `expdesign --help` needs no CasADi.
__getattr__ = names_loaded_when_used(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
