"""Recordings as they would be without the errors of the measurement that were estimated."""

from __future__ import annotations

from dataclasses import replace

from estimation.data.measurement import Measurement
from estimation.estimators import DeviatingMachine, Systematic
from expdesign.robot import Robot


def estimated_machine(robot: Robot, systematic: Systematic | None) -> DeviatingMachine:
    """Return the machine as an estimate found it; as described where none of θ was estimated."""
    if systematic is None or not systematic.estimated:
        return DeviatingMachine.exact(robot)
    return DeviatingMachine.of(robot, systematic.deviations, systematic.values)


def corrected(data: Measurement, machine: DeviatingMachine) -> Measurement:
    """Take the zeros, gains and delay of a machine out of a recording.

    The rate of its clock stays: what it moves besides is far below the noise.
    """
    if not machine.chosen:
        return data
    return replace(
        data,
        lengths=data.lengths - machine.zeros,
        forces=data.forces / machine.gains,
        force_delay=data.force_delay + machine.delay,
    )
