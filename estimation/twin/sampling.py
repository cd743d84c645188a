"""When an experiment is sampled: at the rate given, whether or not it divides the period."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.configuration.sections.experiment import ExperimentSection
from expdesign.configuration.sizes import SAMPLES

_ROUNDING = 1e-12
_WHOLE = 1e-6
"""Samples by which the last period may be off for all to count as whole and alike."""

MOST_SAMPLES = SAMPLES.most
"""Rows of one measurement: more than an hour at 1 kHz."""


@dataclass(frozen=True)
class SampleGrid:
    """Samples i / sampling, i = 0, 1, …, as many as whole steps fit into all periods; Hz and s.

    `count` is their number T; `per_period` that of one period when it is a whole number, so that
    every period is measured at the same phases, else None.
    """

    sampling: float
    period: float
    periods: int
    count: int
    per_period: int | None

    @classmethod
    def of(
        cls, period: float, experiment: ExperimentSection, file: Path | None = None
    ) -> SampleGrid:
        """Return the samples of an experiment; `file` is named in messages.

        Raises
        ------
        InputError
            There is no sample, or there are too many to be held in memory.
        """
        steps = period * experiment.sampling
        nearest = round(steps)
        alike = nearest >= 1 and abs(steps - nearest) * experiment.periods < _WHOLE
        exact = experiment.periods * (nearest if alike else steps)
        made = f"{experiment.periods} periods of {period:.6g} s at {experiment.sampling:g} Hz"
        if exact * (1 + _ROUNDING) < 1:
            message = f"{made} are {exact:.4g} samples"
            raise InputError(message, file, key="experiment.sampling", allowed="1 sample or more")
        if excess := SAMPLES.excess(int(exact * (1 + _ROUNDING)), made):
            key = "experiment.periods"
            raise InputError(excess.message, file, key=key, allowed=excess.allowed)
        # Every sample before the end of the last period, the one at its beginning included.
        count = int(np.ceil(exact * (1 - _ROUNDING)))
        return cls(
            experiment.sampling, period, experiment.periods, count, nearest if alike else None
        )

    @property
    def duration(self) -> float:
        """Of all periods, s."""
        return self.periods * self.period

    @property
    def times(self) -> Array:
        """(T,) s."""
        return np.arange(self.count) / self.sampling

    @property
    def distinct_times(self) -> Array:
        """(D,) times of the samples at which the motion differs, s: one period when all agree."""
        return np.arange(self.per_period or self.count) / self.sampling

    def repeated(self, values: Array) -> Array:
        """Return (T, …) values of all samples from the (D, …) of the distinct ones."""
        if self.per_period is None:
            return values
        return np.tile(values, (self.periods, *(1,) * (values.ndim - 1)))

    @property
    def period_numbers(self) -> NDArray[np.int64]:
        """(T,) the period that each sample belongs to, from 1."""
        samples = np.arange(self.count)
        if self.per_period is not None:
            return samples // self.per_period + 1
        steps = self.period * self.sampling
        return np.floor(samples / steps * (1 + _ROUNDING)).astype(np.int64) + 1
