"""Excitation trajectories."""

from expdesign.trajectory.fourier import FourierTrajectory, PhaseBasis, PoseSamples

__all__ = ["FourierTrajectory", "PhaseBasis", "PoseSamples"]
