"""Excitation trajectories."""

from expdesign.trajectory.design_file import DesignFile, read_design_file
from expdesign.trajectory.fourier import FourierTrajectory, PhaseBasis, PoseSamples

__all__ = ["DesignFile", "FourierTrajectory", "PhaseBasis", "PoseSamples", "read_design_file"]
