"""What repeats in a recording whose noise is wanted: a motion that is known or not, or nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.data.measurement import Measurement
from estimation.identification.period_choice import UnsuitableDataError, choose_omega
from estimation.processing import PeriodError, Record, make_record
from estimation.processing.period import PeriodSource, omega_from_data
from estimation.processing.rest import at_rest, omega_at_rest, resolution_only
from expdesign.configuration import RunConfiguration
from expdesign.trajectory import FourierTrajectory

_TWO = 2 - 1e-9
_SAME = 1 - 1e-9
"""Correlation from sample to sample from which two channels have no noise of their own."""


def repeated_record(
    configuration: RunConfiguration,
    data: Measurement,
    design: FourierTrajectory | None,
    *,
    certain: bool,
) -> Record:
    """Return a recording by its periods: those of the design, of the run, or its own.

    A machine at rest repeats in every part of the recording.

    Parameters
    ----------
    design : FourierTrajectory or None
        What may have been executed.
    certain : bool
        Whether it was: another period is an error then.

    Raises
    ------
    UnsuitableDataError
        The machine moves, and not periodically, or less than two periods were recorded.
    """
    dead = np.flatnonzero(np.ptp(data.forces, axis=0) == 0) + 1
    if len(dead):
        where = f"actuator{'s' * (len(dead) > 1)} {', '.join(map(str, dead))}"
        raise _refused(data, f"the forces do not change at all ({where}): are they connected?")
    same = np.triu(np.abs(np.corrcoef(np.diff(data.forces, axis=0).T)) > _SAME, 1)
    if np.any(same):
        first, second = np.argwhere(same)[0] + 1
        message = f"the forces of actuators {first} and {second} are the same recording"
        raise _refused(data, f"{message}: look at `data.columns` and the cables")
    if all(resolution_only(column) for column in data.lengths.T):
        return _at_rest(data)
    try:
        omega, source = choose_omega(configuration, data, design)
        record = make_record(data, omega, source)
    except (UnsuitableDataError, PeriodError) as error:
        if at_rest(data):
            return _at_rest(data)
        if certain:
            raise _refused(data, str(error)) from error
        record = _of_its_own(data)
    if record.periods < _TWO:
        if at_rest(data):
            return _at_rest(data)
        raise _refused(
            data,
            f"{record.periods:.3g} periods show no scatter between periods: the noise of a "
            "recording takes two periods or more, or a machine at rest",
        )
    return record


def _of_its_own(data: Measurement) -> Record:
    try:
        return make_record(data, omega_from_data(data), PeriodSource.DATA)
    except PeriodError as error:
        raise _refused(data, f"{error}, and the machine is not at rest") from error


def _at_rest(data: Measurement) -> Record:
    try:
        return make_record(data, omega_at_rest(data), PeriodSource.REST)
    except PeriodError as error:
        raise _refused(data, str(error)) from error


def _refused(data: Measurement, message: str) -> UnsuitableDataError:
    return UnsuitableDataError(
        message,
        file=Path(data.source) if data.source else None,
        key="--data",
        allowed="two periods or more of a motion that repeats, or some seconds at rest",
    )
