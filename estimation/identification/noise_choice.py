"""Noise model of the weights: from the scatter, the run, the robot, or the residuals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from estimation.identification.periods import UnsuitableDataError
from estimation.processing import NoiseEstimate, NoiseModel, PeriodicRecording
from estimation.processing.noise import ENOUGH_FREEDOM
from estimation.processing.smoothing import NoiseLines
from estimation.processing.whitening_filter import given_filter
from estimation.uncertainty.intervals import correlation
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.sections.estimate import SpectrumOrigin
from expdesign.noise import NoiseSpectrum

_STILL = 1e-12
"""Smallest variance, relative to the largest, and eigenvalue of a correlation that is one."""

_FEWEST_FREEDOM = 14.0
"""Fewest degrees of freedom of a scatter as weight: with less its inverse is twice too large."""


def choose_noise(
    configuration: RunConfiguration, record: PeriodicRecording, source: str = ""
) -> NoiseModel:
    """Choose Σ and Δ of one sample.

    The scatter between periods when it has 250 degrees of freedom, (M − 1) N, as two periods of
    many samples have; with less what robot or run give; else the scatter, however little there is
    of it; else the residuals, in which case the covariances are first ones only and come anew from
    the residuals of the fits (`residual_noise`). Forces and lengths are chosen each for itself.

    Raises
    ------
    InputError
        The noise that `estimate.noise` asks for is not available.
    UnsuitableDataError
        A channel does not vary.
    """
    wanted = configuration.run.estimate.noise
    noise = configuration.robot.noise
    given = {
        "forces": None if noise is None else noise.force_covariance,
        "lengths": None if noise is None else noise.length_covariance,
    }
    measured = {"forces": record.forces, "lengths": record.lengths}
    missing = [name for name, covariance in given.items() if covariance is None]
    if wanted == "given" and missing:
        raise InputError(
            "estimate.noise is 'given', but robot and run do not state the noise of "
            f"the {missing[0]}",
            file=configuration.file,
            key="noise",
            allowed="force_std and length_std, or force_covariance and length_covariance",
        )
    if wanted == "estimated" and any(each.scatter is None for each in measured.values()):
        raise InputError(
            f"estimate.noise is 'estimated', but {record.periods:.3g} periods do not show the "
            "scatter between periods",
            file=configuration.file,
            key="estimate.noise",
            allowed="at least 2 periods, or noise: given",
        )

    def chosen(name: str) -> NoiseEstimate:
        repeated, stated = measured[name].scatter, given[name]
        freedom = 0.0 if repeated is None or wanted == "given" else repeated.freedom
        least = _FEWEST_FREEDOM if stated is None else ENOUGH_FREEDOM
        if repeated is not None and (wanted == "estimated" or freedom >= least):
            return repeated
        if stated is not None:
            return NoiseEstimate(stated, np.inf, "given")
        first, _ = record.about_series(measured[name])
        # Means over periods scatter less than the single samples that a covariance is stated for.
        covariance = first.covariance * float(np.mean(measured[name].counts))
        return NoiseEstimate(covariance, first.freedom, "residuals")

    found = NoiseModel(chosen("forces"), chosen("lengths"))
    _refuse_singular("q", found.lengths, source)
    _refuse_singular("Q", found.forces, source)
    origin = configuration.run.estimate.spectrum

    def with_spectrum(name: str, own: NoiseEstimate) -> NoiseEstimate:
        channels = measured[name]
        if own is channels.scatter:
            return channels.noise(origin) or own
        stated = None if noise is None else getattr(noise, f"{name.removesuffix('s')}_spectrum")
        if own.source != "given" or stated is None or channels.repeats is None:
            return own
        return with_stated_spectrum(own, stated, record, origin)

    return NoiseModel(
        with_spectrum("forces", found.forces), with_spectrum("lengths", found.lengths)
    )


def with_stated_spectrum(
    noise: NoiseEstimate,
    stated: NoiseSpectrum,
    record: PeriodicRecording,
    origin: SpectrumOrigin = "auto",
) -> NoiseEstimate:
    """Add a known spectrum to the noise, at the multiples of the motion's ω.

    Raises
    ------
    UnsuitableDataError
        The spectrum ends below half of the sampling frequency.
    """
    sampling, samples = 1 / record.step, record.samples
    if not stated.covers(sampling):
        raise UnsuitableDataError(
            f"the spectrum given for the noise ends at a sampling of {stated.highest:g} Hz, the "
            f"recording has {sampling:g} Hz",
            allowed="a spectrum of this sampling, or estimate.noise: estimated",
        )
    count = samples // 2 + 1
    matrices = stated.harmonics(1 / record.period, count, sampling, record.rows).value
    lines = NoiseLines(matrices.astype(np.complex128), samples, np.inf)
    weights = None if origin == "white" else given_filter(noise.covariance, lines.matrices, samples)
    return replace(noise, lines=lines, filter=weights)


def _refuse_singular(letter: str, noise: NoiseEstimate, source: str) -> None:
    """Refuse channels without noise, or with the noise of another channel."""
    variances = np.diag(noise.covariance)
    still = [f"{letter}{j + 1}" for j in np.flatnonzero(variances <= _STILL * np.max(variances))]
    if still:
        message = f"{', '.join(still)}: the recording shows no noise at all in this channel"
    elif np.linalg.eigvalsh(correlation(noise.covariance))[0] <= _STILL:
        message = f"the noise of {letter}1 … {letter}6 is not that of six independent sensors"
    else:
        return
    raise UnsuitableDataError(
        message,
        file=Path(source) if source else None,
        allowed="six channels that were measured, or noise: given",
    )


def residual_noise(residuals: Array, counts: Array, used: int) -> NoiseEstimate:
    """Return the covariance of a fit's residuals, (R, 6), that used so many parameters.

    Each row stands for as many samples as `counts` says, (R,) or (S,) of the record.
    """
    freedom = max(len(residuals) - used / residuals.shape[1], 1.0)
    weights = counts if len(counts) == len(residuals) else np.full(len(residuals), np.mean(counts))
    covariance = (residuals * weights[:, None]).T @ residuals / freedom
    return NoiseEstimate(covariance, freedom, "residuals")
