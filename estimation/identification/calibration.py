"""Calibration of recordings by the estimated deviations of the machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.data.sensors import SensorResponse
from estimation.estimators import PerturbedMachine, SystematicUncertainty
from estimation.identification.recording import fold_periods
from estimation.processing import PeriodSource
from expdesign.configuration import RunConfiguration
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.robot.deviation import LAGS_OF_FORCES
from expdesign.trajectory import FourierTrajectory


def estimated_machine(robot: Robot, systematic: SystematicUncertainty | None) -> PerturbedMachine:
    """Return the machine with its estimated deviations; the robot as described without any.

    The signs of friction allow for the remaining uncertainty of the delay.
    """
    if systematic is None:
        return PerturbedMachine.exact(robot)
    largest = [
        max((one.std for one in systematic.deviations if one.group == group), default=0.0)
        for group in LAGS_OF_FORCES
    ]
    robot = replace(robot, delay_std=float(np.linalg.norm(largest)))
    if not systematic.estimated:
        return PerturbedMachine.exact(robot)
    return PerturbedMachine.of(robot, systematic.deviations, systematic.values)


def apply_calibration(
    configuration: RunConfiguration,
    data: Measurement,
    design: FourierTrajectory | None,
    machine: PerturbedMachine,
) -> Measurement:
    """Remove the estimated length offsets, force gains, delays and low passes from a recording.

    Low passes become filters of the sensors where means over whole periods show them; elsewhere
    they are inverted at the samples, whose noise grows. The rate of the clock stays: its effect on
    the motion is far below the noise.
    """
    if not machine.chosen:
        return data
    delays = [machine.channel_delays(group) for group in "Qq"]
    low_passes = [machine.low_passes(group) for group in "Qq"]
    if any(map(np.any, (*delays, *low_passes))):
        folded = fold_periods(configuration, data, design)
        period = None if folded.source is PeriodSource.NONE else folded.period
        whole = folded.samples == round(folded.period / folded.step)
        if folded.averaged and not folded.robust and whole:
            sensors = zip((data.force_sensors, data.length_sensors), low_passes, strict=True)
            force_sensors, length_sensors = (SensorResponse.with_low_pass(*one) for one in sensors)
            data = replace(data, force_sensors=force_sensors, length_sensors=length_sensors)
            low_passes = [np.zeros(ACTUATORS)] * 2
        forces, lengths = (
            _without_lags(data, values, delay, constants, period)
            for values, delay, constants in zip(
                (data.forces, data.lengths), delays, low_passes, strict=True
            )
        )
        data = replace(data, forces=forces, lengths=lengths)
    return replace(
        data,
        lengths=data.lengths - machine.zeros,
        forces=data.forces / machine.gains,
        force_delay=data.force_delay + machine.delay,
    )


def _without_lags(
    data: Measurement, values: Array, delays: Array, low_passes: Array, period: float | None
) -> Array:
    """Return channels, (T, 6), before their delays and low passes, (6,), s.

    A first-order low pass y of the time constant τ had the input y + τ ẏ.
    The periods at the ends continue the recording beyond them; without a period its ends do.
    """
    times, slack = data.time, 0.5 * data.step
    knots = times
    if period is not None:
        first = times < times[0] + period - slack
        last = times > times[-1] - period + slack
        knots = np.concatenate([times[first] - period, times, times[last] + period])
        values = np.concatenate([values[first], values, values[last]])
    columns = []
    for own, delay, constant in zip(values.T, delays, low_passes, strict=True):
        spline, at = CubicSpline(knots, own), np.clip(times + delay, knots[0], knots[-1])
        columns.append(spline(at) + constant * spline(at, 1))
    return np.column_stack(columns)
