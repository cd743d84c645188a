"""The executed motion from measured lengths: by Fourier series, or pointwise."""

from estimation.kinematics.clock import clock_error
from estimation.kinematics.fourier_fit import MotionFit, fit_motion
from estimation.kinematics.friction_signs import expected_signs
from estimation.kinematics.order import choose_harmonics
from estimation.kinematics.pointwise import PointwiseMotion, pointwise_motion

__all__ = [
    "MotionFit",
    "PointwiseMotion",
    "choose_harmonics",
    "clock_error",
    "expected_signs",
    "fit_motion",
    "pointwise_motion",
]
