"""What an experiment has beside the designed motion: noise and disturbances, drawn at random.

Each is drawn from a stream of its own, so that none depends on what else is switched on. All
streams are spawned from a seed by the key (repetition, purpose). Repetitions count from 1; the key
0 is that of the experiment itself, whose draws all repetitions share.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, RunConfiguration
from expdesign.configuration.sections.experiment import Cogging, Outliers, TrackingError
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.trajectory import FourierTrajectory

_EXPERIMENT = 0


class Shared(IntEnum):
    """What belongs to the experiment and is the same in all its repetitions."""

    TRACKING_ERROR = 0
    DRIFT = 1


class Repeated(IntEnum):
    """What every repetition draws anew."""

    FORCE_NOISE = 0
    LENGTH_NOISE = 1
    OUTLIERS = 2


def experiment_stream(seed: int, purpose: Shared) -> np.random.Generator:
    """Return the stream of what all repetitions share."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_EXPERIMENT, purpose)))


def repetition_stream(seed: int, repetition: int, purpose: Repeated) -> np.random.Generator:
    """Return a stream of one repetition, counted from 1."""
    if repetition < 1:
        raise ValueError(f"repetitions count from 1; there is no repetition {repetition}")
    # The child that SeedSequence(seed, spawn_key=(repetition,)).spawn() gives at that place.
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(repetition, purpose)))


def noise_covariances(configuration: RunConfiguration) -> tuple[Array, Array]:
    """Return Σ, (6, 6), N², and Δ, (6, 6), m², of robot and run.

    Raises
    ------
    InputError
        They state no noise of the forces, or none of the lengths.
    """
    noise = configuration.robot.noise
    given: dict[str, Any] = {
        what: getattr(noise, f"{what}_covariance", None) for what in ("force", "length")
    }
    problems = [
        Problem(
            f"a simulated experiment needs the noise of the {what}s, and neither robot nor "
            "run state it",
            file=configuration.file,
            key="noise",
            allowed=f"{what}_std (six values) or {what}_covariance (6 × 6)",
        )
        for what, covariance in given.items()
        if covariance is None
    ]
    if problems:
        raise InputError(problems)
    return given["force"], given["length"]


def noise_draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw samples, (count, 6), that are independent of each other."""
    factor = np.linalg.cholesky(covariance)
    return rng.standard_normal((count, len(covariance))) @ factor.T


def executed_motion(
    design: FourierTrajectory, error: TrackingError | None, rng: np.random.Generator
) -> FourierTrajectory:
    """Return the motion that the machine makes of a designed one.

    A controller that repeats a periodic command repeats its error, too: the deviation of each
    pose coordinate is a Fourier series in the harmonics first … last of the same ω. Its
    amplitudes are drawn from one normal distribution and scaled so that the root mean square of
    the deviation over one period is exactly the size given: `position` for x, y, z and `angle`
    for φ, θ, ψ.
    Without an error the design stays as it is.
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
    """Return what cogging of linear motors adds to the forces, (T, 6), N.

    It is amplitude · sin(2π q/pitch + phase) of the true lengths q, (T, 6), m.

    The sign is that of friction in the model: it is the force that the actuator gives beyond the
    model's, Q = A p + c(q). The attraction between magnets and iron that pulls the slider out at
    a length q is therefore −c(q).
    """
    angle = 2 * np.pi * lengths / np.asarray(cogging.pitch) + np.asarray(cogging.phase)
    return np.asarray(cogging.amplitude) * np.sin(angle)


def final_drift(size: float, rng: np.random.Generator) -> Array:
    """Return the drift of the six lengths at the end of the experiment, m: size with its sign."""
    return size * rng.choice((-1.0, 1.0), ACTUATORS)


def length_drift(final: Array, time: Array, duration: float) -> Array:
    """Return the drift of the lengths, (T, 6), m, at times from the start, (T,), s.

    As of a machine that warms up, it is half a cosine to the final value, (6,), m.
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
