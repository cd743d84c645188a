"""Periodic forces: cogging, with a scan of the pitch, and hum locked to the motion.

Cogging is periodic in a strut's length. For strut j and pitch τ the columns sin(2π l_j/τ) and
cos(2π l_j/τ) of actuator j are tested jointly. Their statistic is χ² with two degrees of freedom at
every pitch; its maximum over all pitches exceeds u with a probability of at most (Davies,
Biometrika 74, 1987)

    P ≤ e^(−u/2) (1 + √(u/2π) ∫ √λ₂ df),   √λ₂ = 2π std(l_j),

with Rice's rate of upcrossings of the envelope of the two components, f = 1/τ.

A hum at a multiple of the motion's frequency is the same in every period: contrasts between periods
cancel it, and the mean over the periods keeps it. In the mean residuals it is one line, at the
nearest multiple of the base frequency.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from constraints.arrays import Array
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.significance import POSITION_PERIODIC, log_pair_tail
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import described

SAMPLES_PER_PITCH = 4.0
"""Smallest number of samples per pitch at the largest speed; shorter pitches are not scanned."""
_OVERSAMPLING = 4
_SEEN = 1e-6
"""Smallest share of a column's information that must remain given the model's columns."""


@dataclass(frozen=True, eq=False)
class PitchScan:
    """Scan of the pitches of one strut."""

    strut: int
    pitches: Array
    statistic: Array
    """(P,), pitches, m, descending, and the statistic of each, with two degrees of freedom; empty
    if the strut moves too little or too fast."""
    best_pitch: float
    best: float
    """Pitch of the largest statistic, refined between the points of the scan, and its value; NaN
    and 0 for an empty scan."""
    log_p: float
    """Logarithm of p, over all pitches of this strut."""
    critical: float
    """Statistic that is significant over all struts and pitches."""
    reach: float
    """∫ √λ₂ df over the scan."""


@dataclass(frozen=True)
class PeriodicForce:
    """Force amplitude · sin(2π length / pitch + phase) in one strut."""

    pitch: Annotated[float, described("m", "period in the strut's length")]
    pitch_std: Annotated[float, described("m", "its standard deviation")]
    amplitude: Annotated[float, described("N", "amplitude")]
    amplitude_std: Annotated[float, described("N", "its standard deviation")]
    phase: Annotated[float, described("rad", "at length zero: its error is mostly the pitch's")]
    phase_std: Annotated[float, described("rad", "its standard deviation")]
    centre: Annotated[float, described("m", "mean length of the strut")]
    centre_phase: Annotated[float, described("rad", "phase at that length")]
    centre_phase_std: Annotated[float, described("rad", "its standard deviation")]


def scan_pitches(
    solved: SolvedSystem,
    part: Linearisation,
    strut: int,
    step: float,
    level: float = POSITION_PERIODIC,
) -> PitchScan:
    """Scan the pitches of one strut, with samples `step` apart, s.

    The level covers all struts and pitches together.
    """
    length = part.position[:, strut]
    frequencies = _frequencies(length, part.speed[:, strut], step)
    if not len(frequencies):
        nothing = np.zeros(0)
        return PitchScan(strut, nothing, nothing, np.nan, 0.0, 0.0, np.inf, 0.0)
    pair_statistic = _pair_statistic(solved, strut, length - np.mean(length))
    statistic = pair_statistic(frequencies)
    top = int(np.argmax(statistic))
    spacing = frequencies[1] - frequencies[0]
    found = minimize_scalar(
        lambda f: -float(pair_statistic(f)[0]),
        bounds=(
            max(frequencies[0], frequencies[top] - spacing),
            min(frequencies[-1], frequencies[top] + spacing),
        ),
        method="bounded",
    )
    best, frequency = max((-float(found.fun), float(found.x)), (statistic[top], frequencies[top]))
    reach = 2 * np.pi * float(np.std(length)) * (frequencies[-1] - frequencies[0])
    freedom = solved.system.freedom
    return PitchScan(
        strut=strut,
        pitches=1 / frequencies,
        statistic=statistic,
        best_pitch=1 / frequency,
        best=best,
        log_p=log_exceedance(best, reach, freedom),
        critical=critical_value(level / ACTUATORS, reach, freedom),
        reach=reach,
    )


def log_exceedance(statistic: float, reach: float, freedom: float) -> float:
    """Return the logarithm of the bound on P(largest statistic of one strut > statistic).

    `reach` is ∫ √λ₂ df over the scan, `freedom` the degrees of freedom of Σ.
    """
    log_p = float(log_pair_tail(np.array(statistic), freedom))
    return min(0.0, log_p + float(np.log1p(np.sqrt(statistic / (2 * np.pi)) * reach)))


def critical_value(level: float, reach: float, freedom: float) -> float:
    """Return the statistic with at most this probability of being exceeded in one strut."""
    highest = 100.0
    while log_exceedance(highest, reach, freedom) > np.log(level):
        highest *= 2
    return float(brentq(lambda u: log_exceedance(u, reach, freedom) - np.log(level), 0.0, highest))


def periodic_columns(
    part: Linearisation, strut: int, pitch: float, coefficients: tuple[float, float]
) -> Array:
    """Return the columns of sine, cosine and a change of 1/pitch, (R, 6, 3)."""
    length = part.position[:, strut]
    centred = length - np.mean(length)
    angle = 2 * np.pi * centred / pitch
    a, b = coefficients
    columns = np.zeros((len(length), part.position.shape[1], 3))
    columns[:, strut, 0] = np.sin(angle)
    columns[:, strut, 1] = np.cos(angle)
    columns[:, strut, 2] = 2 * np.pi * centred * (a * np.cos(angle) - b * np.sin(angle))
    return columns


def periodic_force(
    part: Linearisation, strut: int, pitch: float, coefficients: Array, covariance: Array
) -> PeriodicForce:
    """Convert the coefficients of the three columns to amplitude, pitch and phase."""
    a, b, shift = coefficients
    frequency = 1 / pitch + shift
    amplitude = float(np.hypot(a, b))
    centre = float(np.mean(part.position[:, strut]))
    centre_phase = float(np.arctan2(b, a))
    to_amplitude = np.array([a, b, 0.0]) / amplitude
    to_phase = np.array([-b, a, 0.0]) / amplitude**2
    to_origin = to_phase - np.array([0.0, 0.0, 2 * np.pi * centre])

    def std(slope: Array) -> float:
        return float(np.sqrt(slope @ covariance @ slope))

    return PeriodicForce(
        pitch=float(1 / frequency),
        pitch_std=float(np.sqrt(covariance[2, 2]) / frequency**2),
        amplitude=amplitude,
        amplitude_std=std(to_amplitude),
        phase=_wrap(centre_phase - 2 * np.pi * frequency * centre),
        phase_std=std(to_origin),
        centre=centre,
        centre_phase=centre_phase,
        centre_phase_std=std(to_phase),
    )


def _wrap(angle: float) -> float:
    return float(np.mod(angle + np.pi, 2 * np.pi) - np.pi)


def _frequencies(length: Array, speed: Array, step: float) -> Array:
    """Return 1/pitch, from one pitch per stroke to the shortest resolved by the samples."""
    stroke = float(np.ptp(length))
    if stroke <= 0:
        return np.zeros(0)
    finest = float(np.max(np.abs(speed))) * step
    highest = 1 / (SAMPLES_PER_PITCH * finest) if finest > 0 else 0.0
    count = int(np.floor((highest * stroke - 1) * _OVERSAMPLING)) + 1
    if count < 2:  # noqa: PLR2004 - a scan has two ends
        return np.zeros(0)
    return (1 + np.arange(count) / _OVERSAMPLING) / stroke


def _pair_statistic(
    solved: SolvedSystem, strut: int, length: Array
) -> Callable[[Array | float], Array]:
    """Return a function for χ² of sine and cosine of a strut's length, by their frequencies."""
    system = solved.system
    # zᵀ W e* and zᵀ W U of a column z in this actuator alone.
    residual = system.force_rows.apply_weights(solved.rest[:, :, None])[:, strut, 0]
    mixed = system.force_rows.apply_weights(system.columns)[:, strut] @ solved.root
    weight = system.force_rows.quadratic(strut)
    one = np.ones((1, len(length)))
    whole = float(weight(one, one)[0])

    def statistic(frequencies: Array | float) -> Array:
        angle = 2 * np.pi * np.multiply.outer(np.atleast_1d(frequencies), length)
        sin, cos = np.sin(angle), np.cos(angle)
        scores = np.stack([sin @ residual, cos @ residual], axis=1)
        sin_mixed, cos_mixed = sin @ mixed, cos @ mixed
        ss = weight(sin, sin) - np.sum(sin_mixed**2, axis=1)
        sc = weight(sin, cos) - np.sum(sin_mixed * cos_mixed, axis=1)
        cc = weight(cos, cos) - np.sum(cos_mixed**2, axis=1)
        determinant = ss * cc - sc**2
        seen = determinant > _SEEN * whole**2 / 4
        value = cc * scores[:, 0] ** 2 - 2 * sc * scores[:, 0] * scores[:, 1]
        value = value + ss * scores[:, 1] ** 2
        return np.where(seen, value / np.where(seen, determinant, 1.0), 0.0)

    return statistic
