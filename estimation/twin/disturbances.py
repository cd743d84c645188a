"""What an experiment has beside the designed motion and noise: what disturbs real measurements."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import Cogging, Outliers, TrackingError
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.trajectory import FourierTrajectory


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
    error : TrackingError or None
        None leaves the design as it is.
    rng : Generator
        For 2 · 6 · (last − first + 1) normal draws.
    """
    if error is None or error.position == error.angle == 0:
        return design
    first, last = error.harmonics
    sizes = np.repeat([error.position, error.angle], COORDINATES // 2)
    drawn = rng.standard_normal((2, COORDINATES, last - first + 1))
    # A series Σ a sin kωt + b cos kωt has the mean square Σ (a² + b²)/2 over a period.
    rms = np.sqrt(np.sum(drawn**2, axis=(0, 2)) / 2)
    sine, cosine = drawn * (sizes / rms)[:, None]
    orders = design.omega * np.arange(first, last + 1)
    more = ((0, 0), (0, max(last - design.harmonics, 0)))
    mu, nu = np.pad(design.mu, more), np.pad(design.nu, more)
    mu[:, first - 1 : last] += sine * orders
    nu[:, first - 1 : last] -= cosine * orders
    return FourierTrajectory(design.omega, design.lambda0, mu, nu)


def cogging_force(lengths: Array, cogging: Cogging) -> Array:
    """Return what cogging of linear motors adds to the forces: amplitude · sin(2π q/pitch + phase).

    The sign is that of friction in the model: it is the force that the actuator gives beyond the
    model's, Q = A p + c(q). The attraction between magnets and iron that pulls the slider out at
    a length q is therefore −c(q).

    Parameters
    ----------
    lengths : (T, 6)
        True strut lengths q, m.
    cogging : Cogging
        Amplitude in N, pitch in m, phase in rad of every strut.

    Returns
    -------
    (T, 6)
        N.
    """
    angle = 2 * np.pi * lengths / np.asarray(cogging.pitch) + np.asarray(cogging.phase)
    return np.asarray(cogging.amplitude) * np.sin(angle)


def final_drift(size: float, rng: np.random.Generator) -> Array:
    """Return the drift of the six lengths at the end of the experiment, m: size with its sign."""
    return size * rng.choice((-1.0, 1.0), ACTUATORS)


def length_drift(final: Array, time: Array, duration: float) -> Array:
    """Return the drift of the lengths, (T, 6), as of a machine that warms up: half a cosine.

    Parameters
    ----------
    final : (6,)
        Value at the end, m.
    time : (T,)
        s, from the start.
    duration : float
        Of the experiment, s.
    """
    return np.multiply.outer((1 - np.cos(np.pi * time / duration)) / 2, final)


def gross_errors(outliers: Outliers, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the gross errors of lengths (m) and forces (N), (count, 6) each; mostly zeros.

    Every sample of every channel is hit with the probability `share`, independently of the
    others, and is then off by the size given, up or down with the same probability.
    """
    uniform = rng.random((count, 2 * ACTUATORS))
    up, down = uniform < outliers.share / 2, uniform >= 1 - outliers.share / 2
    signs = up.astype(float) - down
    return outliers.length * signs[:, :ACTUATORS], outliers.force * signs[:, ACTUATORS:]


def quantised(values: Array, step: float) -> Array:
    """Return the values in steps of an encoder or converter; as they are where the step is 0."""
    return np.round(values / step) * step if step > 0 else values
