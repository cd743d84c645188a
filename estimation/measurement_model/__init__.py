"""Predicted lengths and forces for a motion and parameters, with derivatives."""

from estimation.measurement_model.motion import HarmonicMotion, Motion
from estimation.measurement_model.spline import SplineMotion

__all__ = ["HarmonicMotion", "Motion", "SplineMotion"]
