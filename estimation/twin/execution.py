"""The executed motion: the design with the tracking error of the machine's control."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import TrackingError
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory import FourierTrajectory

_POSITIONS = 3


def executed_motion(
    design: FourierTrajectory, error: TrackingError | None, rng: np.random.Generator
) -> FourierTrajectory:
    """Return the motion that the machine makes of a designed one.

    A controller that repeats a periodic command repeats its error, too: the deviation of each
    pose coordinate is a Fourier series in the harmonics first … last of the same ω. Its
    amplitudes are drawn from one normal distribution and scaled so that the root mean square of
    the deviation over one period is exactly the size given: `position` for x, y, z and `angle`
    for φ, θ, ψ.

    Parameters
    ----------
    design : FourierTrajectory
    error : TrackingError or None
        None leaves the design as it is.
    rng : Generator
        For 2 · 6 · (last − first + 1) normal draws.
    """
    if error is None or error.position == error.angle == 0:
        return design
    first, last = error.harmonics
    sizes = np.repeat([error.position, error.angle], _POSITIONS)
    drawn = rng.standard_normal((2, COORDINATES, last - first + 1))
    # A series Σ a sin kωt + b cos kωt has the mean square Σ (a² + b²)/2 over a period.
    rms = np.sqrt(np.sum(drawn**2, axis=(0, 2)) / 2)
    sine, cosine = drawn * (sizes / rms)[:, None]
    harmonics = max(design.harmonics, last)
    orders = design.omega * np.arange(first, last + 1)
    mu, nu = _padded(design.mu, harmonics), _padded(design.nu, harmonics)
    mu[:, first - 1 : last] += sine * orders
    nu[:, first - 1 : last] -= cosine * orders
    return FourierTrajectory(design.omega, design.lambda0, mu, nu)


def _padded(amplitudes: Array, harmonics: int) -> Array:
    wider = np.zeros((COORDINATES, harmonics))
    wider[:, : amplitudes.shape[1]] = amplitudes
    return wider
