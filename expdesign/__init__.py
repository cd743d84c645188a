"""Optimal experiment design and identification for hexapods.

`load_robot` gives the model, `design` the excitation trajectory of a run.
"""

from expdesign.configuration import ConfigurationError, load_run
from expdesign.experiment import DesignResult, design
from expdesign.robot import Robot, load_robot
from expdesign.trajectory import FourierTrajectory

__all__ = [
    "ConfigurationError",
    "DesignResult",
    "FourierTrajectory",
    "Robot",
    "design",
    "load_robot",
    "load_run",
]
