"""Predicted lengths and forces for a motion and parameters, with derivatives."""

from estimation.measurement_model.motion import HarmonicMotion

__all__ = ["HarmonicMotion"]
