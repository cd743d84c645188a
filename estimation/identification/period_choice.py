"""Which period a recording has: the design's, the file's, the run's, or the data's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.data.measurement import Measurement
from estimation.processing.period import (
    PeriodError,
    PeriodSource,
    omega_from_column,
    omega_from_data,
    refined_omega,
)
from expdesign.configuration import ConfigurationError, Problem, RunConfiguration
from expdesign.trajectory import FourierTrajectory

_FREQUENCY_REACH = 0.02
"""How far the controller's clock may be off, relative, when the frequency is estimated."""

_FEWEST_MARKED = 3
"""Numbers that a period column must have: fewer do not mark the two ends of a period."""

_REPEATS = 0.5
"""Largest difference between a sample and the one a period later, rms, as a share of the motion."""


def choose_omega(
    configuration: RunConfiguration, data: Measurement, design: FourierTrajectory | None
) -> tuple[float, PeriodSource]:
    """Return ω, rad/s, and where it came from.

    Raises
    ------
    ConfigurationError
        No period is known and none is found, or the data do not repeat with it.
    """
    low, high = configuration.run.trajectory.frequency
    try:
        if design is not None:
            omega, source = design.omega, PeriodSource.DESIGN
        elif data.period is not None and len(np.unique(data.period)) >= _FEWEST_MARKED:
            omega, source = omega_from_column(data), PeriodSource.COLUMN
        elif low == high:
            omega, source = 2 * np.pi * low, PeriodSource.FREQUENCY
        else:
            omega, source = omega_from_data(data), PeriodSource.DATA
    except PeriodError as error:
        raise _refused(data, str(error)) from error
    if configuration.run.estimate.frequency == "estimated" and source is not PeriodSource.DATA:
        omega = refined_omega(data, omega, _FREQUENCY_REACH)
    if source is not PeriodSource.DATA:
        _refuse_other_period(data, omega, source)
    return float(omega), source


def _refuse_other_period(data: Measurement, omega: float, source: PeriodSource) -> None:
    """Refuse a period with which the lengths do not repeat."""
    period = 2 * np.pi / omega
    later = data.time + period
    inside = later <= data.time[-1]
    if np.count_nonzero(inside) < max(2, 0.1 * period / data.step):
        return
    columns = data.lengths.T
    shifted = np.stack([np.interp(later[inside], data.time, column) for column in columns], axis=1)
    difference = shifted - data.lengths[inside]
    # Medians: outliers are no evidence against a period.
    off = np.median(np.abs(difference - np.median(difference, axis=0)), axis=0)
    moving = np.median(np.abs(data.lengths - np.median(data.lengths, axis=0)), axis=0)
    if np.median(off) <= _REPEATS * np.median(moving):
        return
    try:
        seen = f"; the lengths repeat after {2 * np.pi / omega_from_data(data):.6g} s"
    except PeriodError:
        seen = "; no other period was found either"
    raise _refused(
        data, f"the lengths do not repeat with the {source.value}'s period of {period:.6g} s{seen}"
    )


def _refused(data: Measurement, message: str) -> ConfigurationError:
    return ConfigurationError(
        Problem(
            message,
            file=Path(data.source) if data.source else None,
            allowed="a design (--design), a period column, a fixed trajectory.frequency, or data "
            "that repeat",
        )
    )
