"""Optimal experiment design and identification for hexapods.

`load_robot` gives the model, `design` the excitation trajectory of a run.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from expdesign.configuration import InputError, load_run
    from expdesign.experiment import DesignResult, design
    from expdesign.robot import Robot, load_robot
    from expdesign.trajectory import FourierTrajectory

__all__ = [
    "DesignResult",
    "FourierTrajectory",
    "InputError",
    "Robot",
    "design",
    "load_robot",
    "load_run",
]

_HOMES = {
    "InputError": "expdesign.configuration",
    "DesignResult": "expdesign.experiment",
    "FourierTrajectory": "expdesign.trajectory",
    "Robot": "expdesign.robot",
    "design": "expdesign.experiment",
    "load_robot": "expdesign.robot",
    "load_run": "expdesign.configuration",
}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: `expdesign --help` needs no CasADi."""
    if name not in _HOMES:
        raise AttributeError(f"module 'expdesign' has no attribute '{name}'")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
