"""Which covariances the estimators weight with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.processing import NoiseModel, Record
from estimation.processing.noise import scatter_about_series, series_harmonics
from expdesign.configuration import ConfigurationError, Problem, RunConfiguration

_STILL = 1e-12
"""Smallest variance, relative to the largest, and eigenvalue of a correlation that is one."""

FEWEST_PERIODS = 3
"""Periods from which on the scatter between them is preferred to what is given."""


def choose_noise(configuration: RunConfiguration, record: Record, source: str = "") -> NoiseModel:
    """Return Σ and Δ of one sample.

    The scatter between periods from three periods on; with fewer what robot or run give; else the
    residuals, in which case the covariance of the forces is a first one only and comes anew from
    the residuals of the fit (`residual_noise`).

    Raises
    ------
    ConfigurationError
        `estimate.noise` asks for what is not there, or a channel does not vary.
    """
    noise = _chosen(configuration, record)
    _refuse_singular(noise, source)
    return noise


def _refuse_singular(noise: NoiseModel, source: str) -> None:
    """Refuse channels without noise, or whose noise is another channel's."""
    for letter, covariance in (("q", noise.length_covariance), ("Q", noise.force_covariance)):
        variances = np.diag(covariance)
        largest = float(np.max(variances))
        still = [f"{letter}{j + 1}" for j in np.flatnonzero(variances <= _STILL * largest)]
        if not still:
            std = np.sqrt(variances)
            alike = np.linalg.eigvalsh(covariance / np.multiply.outer(std, std))[0]
            if alike > _STILL:
                continue
            message = f"the noise of {letter}1 … {letter}6 is not that of six independent sensors"
        else:
            message = f"{', '.join(still)}: the recording shows no noise at all in this channel"
        raise ConfigurationError(
            Problem(
                message,
                file=Path(source) if source else None,
                allowed="six channels that were measured, or noise: given",
            )
        )


def _chosen(configuration: RunConfiguration, record: Record) -> NoiseModel:
    wanted = configuration.run.estimate.noise
    noise = configuration.robot.noise
    forces = None if noise is None else noise.force_covariance
    lengths = None if noise is None else noise.length_covariance
    if wanted == "given":
        if forces is None or lengths is None:
            raise ConfigurationError(
                Problem(
                    "estimate.noise is 'given', but robot and run do not state the noise of "
                    + ("the forces" if forces is None else "the lengths"),
                    file=configuration.file,
                    key="noise",
                    allowed="force_std and length_std, or force_covariance and length_covariance",
                )
            )
        return NoiseModel(forces, lengths, "given")
    repeated = record.force_scatter is not None and record.length_scatter is not None
    enough = record.periods >= FEWEST_PERIODS - 1e-6
    if (
        record.force_scatter is not None
        and record.length_scatter is not None
        and (enough or wanted == "estimated")
    ):
        return NoiseModel(
            record.force_scatter.covariance,
            record.length_scatter.covariance,
            "estimated",
            record.force_scatter.freedom,
            record.length_scatter.freedom,
        )
    if wanted == "estimated" and not repeated:
        raise ConfigurationError(
            Problem(
                f"estimate.noise is 'estimated', but {record.periods:.3g} periods do not show the "
                "scatter between periods",
                file=configuration.file,
                key="estimate.noise",
                allowed="at least 2 periods (3 are better), or noise: given",
            )
        )
    if forces is not None and lengths is not None:
        return NoiseModel(forces, lengths, "given")
    return _first_noise(record)


def _first_noise(record: Record) -> NoiseModel:
    """Return covariances of the scatter about a long Fourier series of what was recorded."""
    per_period = record.samples if record.averaged else record.period / record.step
    harmonics = series_harmonics(record.samples, per_period)
    forces, _ = scatter_about_series(record.force_times, record.forces, record.omega, harmonics)
    lengths, _ = scatter_about_series(record.length_times, record.lengths, record.omega, harmonics)
    # Means over periods scatter less than the single samples that a covariance is stated for.
    return NoiseModel(
        forces.covariance * float(np.mean(record.force_counts)),
        lengths.covariance * float(np.mean(record.length_counts)),
        "residuals",
        forces.freedom,
        lengths.freedom,
    )


def residual_noise(
    record: Record, noise: NoiseModel, residuals: np.ndarray, used: int
) -> NoiseModel:
    """Return the noise with Σ from the residuals of a fit, (R, 6), that used so many parameters."""
    freedom = max(len(residuals) - used / residuals.shape[1], 1.0)
    covariance = residuals.T @ residuals / freedom * float(np.mean(record.force_counts))
    return NoiseModel(
        covariance, noise.length_covariance, "residuals", freedom, noise.length_freedom
    )
