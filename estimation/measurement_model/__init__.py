"""Predicted lengths and forces for a motion and parameters, with derivatives."""

from estimation.measurement_model.motion import HarmonicMotion
from estimation.measurement_model.prediction import ForcePrediction, predict_forces, predict_lengths

__all__ = ["ForcePrediction", "HarmonicMotion", "predict_forces", "predict_lengths"]
