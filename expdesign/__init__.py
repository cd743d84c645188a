"""Optimal experiment design and identification for hexapods.

`load_robot` gives the model, `load_measurement` a recording. `design`, `simulate`, `estimate` and
`report` are the stages that are called most; `run` does all that a run file names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from expdesign.configuration import InputError, load_run
    from expdesign.experiment import DesignResult, design
    from expdesign.robot import Robot, load_robot
    from expdesign.stages.estimate import estimate, load_measurement
    from expdesign.stages.experiment import simulate
    from expdesign.stages.run import RunResult, report, run
    from expdesign.stages.stage import Progress, StageFailed
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
    "Progress": "expdesign.stages.stage",
    "StageFailed": "expdesign.stages.stage",
    "RunResult": "expdesign.stages.run",
    "estimate": "expdesign.stages.estimate",
    "load_measurement": "expdesign.stages.estimate",
    "report": "expdesign.stages.run",
    "run": "expdesign.stages.run",
    "simulate": "expdesign.stages.experiment",
}


def __getattr__(name: str) -> Any:
    # On first use: `expdesign --help` needs no CasADi.
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
