"""The executed motion from measured lengths: by Fourier series, or pointwise."""

from estimation.kinematics.fourier_fit import MotionFit, choose_harmonics, fit_motion
from estimation.kinematics.friction_signs import expected_signs
from estimation.kinematics.pointwise import PointwiseMotion, pointwise_motion

__all__ = [
    "MotionFit",
    "PointwiseMotion",
    "choose_harmonics",
    "expected_signs",
    "fit_motion",
    "pointwise_motion",
]
