"""Excitation trajectories."""

from expdesign.trajectory.design_file import FourierKeys, TrajectoryFile, fourier_keys
from expdesign.trajectory.fourier import FourierTrajectory, PhaseBasis, PoseSamples

__all__ = [
    "FourierKeys",
    "FourierTrajectory",
    "PhaseBasis",
    "PoseSamples",
    "TrajectoryFile",
    "fourier_keys",
]
