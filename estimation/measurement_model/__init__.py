"""What lengths and forces should have been for a motion and parameters, with derivatives."""

from estimation.measurement_model.motion import HarmonicMotion, MotionBasis
from estimation.measurement_model.prediction import ForcePrediction, predict_forces, predict_lengths

__all__ = ["ForcePrediction", "HarmonicMotion", "MotionBasis", "predict_forces", "predict_lengths"]
