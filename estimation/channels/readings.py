"""Readings of the lengths at some instants, and motions through their poses."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from constraints.arrays import Array, Mask
from estimation.measurement_model import HarmonicMotion, Motion, SplineMotion
from estimation.processing import PeriodicRecording
from estimation.processing.periodic_recording import Channels
from estimation.splines import fit_splines, instants_of, smooth_channels
from expdesign.trajectory import PhaseBasis

_ROWS = 256
"""Largest number of instants of a period."""
_OF_LENGTHS = 4
"""Harmonics of a length that is shifted, relative to those of the motion."""
_SLOW = 0.05
"""Rate of a length, relative to its root mean square, up to which the sign of dry friction is not
known without a period: the machine may be at rest."""
_FEWEST = 100
"""Samples of the forces at moving struts that a check needs."""
_MOVES = 5.0
"""Least standard deviation of a length that moves, in those of its noise."""
MOST_LATE = 20
"""Steps of the longest delay that is tried: the ends of a recording without a period."""


class TooLittleMotionError(ValueError):
    """A recording without a period in which too few samples are of moving struts."""


class Readings(Protocol):
    """Readings of the lengths."""

    times: Array
    """(R,), s."""
    values: Array
    """(R, 6), m."""

    def change(self, channel: int, seconds: float) -> Array:
        """Return the change of a reading, (R,), with the values of a later instant."""

    def fit_motion(self, poses: Array) -> Motion:
        """Return the motion with these poses, (R, 6)."""

    def hold(self, times: Array) -> Array:
        """Return instants, s, of which the motion is known; the first and last one for others."""

    def used_forces(self, times: Array) -> Mask | None:
        """Return the samples of the forces, (S,), where the motion is known well; None: all.

        Raises
        ------
        TooLittleMotionError
            There are too few.
        """


def readings_of(recording: PeriodicRecording, harmonics: int | None) -> Readings:
    """Return the lengths of a recording by the harmonics of its motion; None: it has no period.

    Raises
    ------
    MotionFitError
        A recording without a period is too short.
    """
    if harmonics is None:
        return _SplineReadings(recording)
    return _PeriodicReadings(recording, harmonics)


class _PeriodicReadings:
    """Samples of a motion with a period."""

    def __init__(self, recording: PeriodicRecording, harmonics: int) -> None:
        self.times, self.values, _ = thin_rows(recording.lengths, _ROWS)
        self._omega = recording.omega
        most = (len(self.values) - 1) // 2
        self._harmonics = min(_OF_LENGTHS * harmonics, most)
        basis = PhaseBasis.at(self._omega * self.times, min(harmonics, most))
        self._to_series = np.asarray(np.linalg.pinv(basis.value), np.float64)

    def change(self, channel: int, seconds: float) -> Array:
        now, late = (
            PhaseBasis.at(self._omega * (self.times + shift), self._harmonics).value
            for shift in (0.0, seconds)
        )
        series = np.linalg.lstsq(now, self.values[:, channel], rcond=None)[0]
        return np.asarray((late - now) @ series)

    def fit_motion(self, poses: Array) -> HarmonicMotion:
        return HarmonicMotion((self._to_series @ poses).T, self._omega)

    def hold(self, times: Array) -> Array:
        return times

    def used_forces(self, times: Array) -> None:
        del times  # the motion is known at all of them


class _SplineReadings:
    """Splines of all samples of a motion without a period."""

    def __init__(self, recording: PeriodicRecording) -> None:
        lengths = recording.lengths
        smooth = smooth_channels(lengths.times, lengths.values)
        self._splines, self._noise = smooth.motion, smooth.scatter.covariance
        self.times = instants_of(self._splines)
        self.values = self._splines.poses(self.times)
        self._edge = MOST_LATE * recording.step
        self._ends = lengths.times[[0, -1]]

    def change(self, channel: int, seconds: float) -> Array:
        later = self._splines.poses(self.hold(self.times + seconds))
        return np.asarray(later[:, channel] - self.values[:, channel])

    def fit_motion(self, poses: Array) -> SplineMotion:
        found = fit_splines(self.times, poses, self._splines.intervals)
        if found is None:
            raise AssertionError("three instants of each interval determine its splines")
        return found.motion

    def hold(self, times: Array) -> Array:
        return np.clip(times, *self._ends)

    def used_forces(self, times: Array) -> Mask:
        if np.any(np.std(self.values, axis=0) < _MOVES * np.sqrt(np.diag(self._noise))):
            raise TooLittleMotionError("not all struts move")
        rates = np.abs(self._splines.at(times).state()[:, 6:12])
        moving = np.min(rates / np.sqrt(np.mean(rates**2, axis=0)), axis=1) > _SLOW
        first, last = self._ends
        used = np.asarray(moving & (times > first + self._edge) & (times < last - self._edge))
        if np.count_nonzero(used) < _FEWEST:
            raise TooLittleMotionError(f"fewer than {_FEWEST} samples are of moving struts")
        return used


def thin_rows(
    channels: Channels, most: int, used: Mask | None = None
) -> tuple[Array, Array, Array]:
    """Return times, values and counts of at most so many (used) rows of a recording's channels."""
    rows = np.arange(len(channels.values)) if used is None else np.flatnonzero(used)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, most).astype(np.intp))]
    return channels.times[rows], channels.values[rows], channels.counts[rows]
