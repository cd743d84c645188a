"""Frequency response of the sensors of a recording: low-pass filters and delays of single channels.

A periodic signal passes a filter line by line. Dividing the lines of a recording by the response
gives the signal before the filter, with a noise whose spectrum is divided as well. Estimators that
weight every line by its noise then give the same result as a model that passes the filter.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from constraints.arrays import Array, ComplexArray
from expdesign.configuration.estimate import ChannelFilter, DataSection
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, series_of

_FLOOR = 1e-4
"""Smallest gain that is divided by: nothing but noise is left at a line below it."""


@dataclass(frozen=True, eq=False)
class SensorResponse:
    """Response of the sensors of the six forces, or of the six lengths."""

    filters: tuple[ChannelFilter | None, ...]
    """Six, by the number of the strut."""
    delays: Array
    """(6,), s, after the mean delay of the channels."""
    constants: Array = field(default_factory=lambda: np.zeros(ACTUATORS))
    """(6,), s, time constants of further low passes of first order."""

    @classmethod
    def of(cls, section: DataSection, group: str) -> SensorResponse | None:
        """Return the response by a run's section `data` of a group, ``q`` or ``Q``.

        None if nothing is filtered and all channels have the same delay.
        """
        delays = np.array(section.channel_delays(group))
        filters = section.channel_filters(group)
        if not any(filters) and np.all(delays == delays[0]):
            return None
        return cls(filters, delays - np.mean(delays))

    def lines(self, samples: int, step: float) -> ComplexArray:
        """Return the response at the lines of a series, (samples // 2 + 1, 6), step in s.

        Gains are at least 1e-4.

        Examples
        --------
        >>> low_pass = ChannelFilter(low_pass=100.0, order=1)
        >>> sensors = SensorResponse((low_pass,) + (None,) * 5, np.zeros(6))
        >>> np.abs(sensors.lines(10, 1e-3)[1]).round(3).tolist()
        [0.707, 1.0, 1.0, 1.0, 1.0, 1.0]
        """
        rates = 2 * np.pi * np.fft.rfftfreq(samples, step)
        response = np.exp(-1j * np.multiply.outer(rates, self.delays))
        response /= 1 + 1j * np.multiply.outer(rates, self.constants)
        for channel, each in enumerate(self.filters):
            if each is None:
                continue
            if each.sampling is None:
                analog = scipy.signal.butter(each.order, 2 * np.pi * each.low_pass, analog=True)
                _, own = scipy.signal.freqs(*analog, worN=rates)
            else:
                digital = scipy.signal.butter(each.order, each.low_pass, fs=each.sampling)
                _, own = scipy.signal.freqz(*digital, worN=rates / each.sampling)
            response[:, channel] *= np.abs(own) ** 2 if each.zero_phase else own
        if samples % 2 == 0:  # a real line
            response[-1] = np.abs(response[-1])
        gain = np.maximum(np.abs(response), _FLOOR)
        return np.asarray(gain * np.exp(1j * np.angle(response)))

    def delay_if_digital(self, step: float) -> float:
        """Return the further mean delay, s, if filters without `sampling` have that of the log.

        Examples
        --------
        >>> filters = (ChannelFilter(low_pass=80.0, order=2),) * 6
        >>> round(1e3 * SensorResponse(filters, np.zeros(6)).delay_if_digital(2e-3), 2)
        -0.24
        """
        digital = tuple(
            one.model_copy(update={"sampling": 1 / step})
            if one and one.sampling is None and one.low_pass < 0.5 / step
            else one
            for one in self.filters
        )
        slow = 1000
        own, other = (each.lines(slow, step)[1] for each in (self, replace(self, filters=digital)))
        return float(np.mean(np.angle(own / other))) * slow * step / (2 * np.pi)

    @staticmethod
    def with_low_pass(sensors: SensorResponse | None, constants: Array) -> SensorResponse | None:
        """Return the response with low passes of first order, time constants (6,) in s."""
        if not np.any(constants):
            return sensors
        known = sensors or SensorResponse((None,) * ACTUATORS, np.zeros(ACTUATORS))
        return replace(known, constants=constants)

    def undo(self, series: Array, step: float) -> Array:
        """Return the periodic series, (n, 6), before filters and delays."""
        return series_of(lines_of(series) / self.lines(len(series), step), len(series))

    def apply(self, series: Array, step: float) -> Array:
        """Return the periodic series, (n, 6), after filters and delays."""
        return series_of(lines_of(series) * self.lines(len(series), step), len(series))
