"""What an experiment has beside the designed motion: disturbances, some of them drawn at random.

Each is drawn from a stream of its own, so that none depends on what else is switched on. All
streams are spawned from a seed by the key (repetition, purpose). Repetitions count from 1; the key
0 is that of the experiment itself, whose draws all repetitions share.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.configuration.sections.experiment import (
    Cogging,
    ForceConstantError,
    Hum,
    Lost,
    Outliers,
    TrackingError,
)
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
    HUM = 3
    LOST = 4


def experiment_stream(seed: int, purpose: Shared) -> np.random.Generator:
    """Return the stream of what all repetitions share."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_EXPERIMENT, purpose)))


def repetition_stream(seed: int, repetition: int, purpose: Repeated) -> np.random.Generator:
    """Return a stream of one repetition, counted from 1."""
    if repetition < 1:
        raise ValueError(f"repetitions count from 1; there is no repetition {repetition}")
    # The child that SeedSequence(seed, spawn_key=(repetition,)).spawn() gives at that place.
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(repetition, purpose)))


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


def force_factors(error: ForceConstantError, time: Array, duration: float) -> Array:
    """Return measured over true force, (T, 6), at times from the start, (T,), s."""
    drift = 1 + np.multiply.outer(time / duration, np.asarray(error.drift))
    return (1 + error.common) * (1 + np.asarray(error.each)) * drift


def hum_force(hum: Hum, time: Array, rng: np.random.Generator) -> Array:
    """Return the hum in the measured forces, (T, 6), N, at times (T,), s.

    Its phase runs on through the whole record, whatever the periods of the motion are.
    """
    phases = rng.uniform(0, 2 * np.pi, (len(hum.harmonics), ACTUATORS))
    if hum.phase is not None:
        phases = np.multiply.outer(np.arange(1, len(hum.harmonics) + 1), hum.phase)
    found = np.zeros((len(time), ACTUATORS))
    for order, (share, phase) in enumerate(zip(hum.harmonics, phases, strict=True), start=1):
        angle = 2 * np.pi * order * hum.frequency * time
        found += share * np.asarray(hum.amplitude) * np.sin(angle[:, None] + phase)
    return found


def kept_samples(lost: Lost, count: int, rng: np.random.Generator) -> Mask:
    """Tell for each of (T,) samples whether the recording has it."""
    if lost.share is not None:
        return rng.random(count) >= lost.share
    kept = np.ones(count, dtype=bool)
    kept[np.array(lost.rows or (), dtype=int) - 1] = False
    return kept
