"""Units of actuators: along the struts, and of their motors through lead, counts and constants."""

from __future__ import annotations

import math
from dataclasses import dataclass

from expdesign.configuration.parameters import DIRECT, Drive
from expdesign.configuration.quantity import (
    ANGLE,
    COUNT,
    CURRENT,
    DUTY,
    FORCE,
    LENGTH,
    TORQUE,
    VOLTAGE,
    quantity_of_unit,
)
from expdesign.configuration.robot import ResolvedRobot
from expdesign.mechanism.hexapod import ACTUATORS

LENGTH_KINDS = (LENGTH, ANGLE, COUNT)
VOLTAGE_KINDS = (VOLTAGE, DUTY)
FORCE_KINDS = (FORCE, TORQUE, CURRENT, *VOLTAGE_KINDS)
"""Quantities that a length or force of a strut may be recorded or commanded in."""


@dataclass(frozen=True)
class ActuatorUnits:
    """Conversion of the units of six actuators to SI along their struts, struts 1 to 6."""

    robot: ResolvedRobot | None
    """Its drive has the lead and the motor; None: not known yet, and not missing."""
    counts_per_metre: tuple[float, ...] | None = None
    """Of the strut's length."""
    counts_per_revolution: tuple[float, ...] | None = None
    """Of the motor."""
    force_constants: tuple[float, ...] | None = None
    """N/A along the strut; None: those of the motor."""
    supply_recorded: bool = False
    """Whether the supply voltage is a column of the recording."""

    @property
    def _drive(self) -> Drive:
        return DIRECT if self.robot is None else self.robot.drive

    def missing(self, unit: str) -> tuple[str, str] | None:
        """Return the lack of a conversion and its remedy; None for a unit that can be converted."""
        kind, motor = quantity_of_unit(unit), self._drive.motor
        if kind is CURRENT and self.force_constants is None and motor is None:
            return (
                "no force constants are given",
                "force_constants: one value or six, in N/A, or the motor in the robot file's drive",
            )
        if kind is COUNT and self.counts_per_metre is None and self.counts_per_revolution is None:
            return (
                "neither counts_per_metre nor counts_per_revolution are given",
                "counts_per_metre: counts of one metre of the strut, or counts_per_revolution: of "
                "one turn of a motor whose lead the robot file states",
            )
        if self.robot is None:
            return None
        name = self.robot.source or self.robot.name
        turning = kind in (ANGLE, TORQUE) or (kind is COUNT and self.counts_per_metre is None)
        if turning and self._drive.geared is None:
            return (
                f"{name} states no lead of the drives",
                "in the robot file drive: {screw: {lead: 5 mm}} or {gear: {lead: …}}, the travel "
                "of a strut in one turn of its motor",
            )
        needed = "constant: 0.05 N m/A, resistance: 1.2 ohm" if kind in VOLTAGE_KINDS else ""
        if kind is DUTY and not self.supply_recorded and (motor is None or motor.supply is None):
            needed += ", supply: 24 V"
        elif motor is not None:
            needed = ""
        if not needed:
            return None
        what = "no motor of the drives" if motor is None else "no supply voltage of the motors"
        recorded = ", or the column of the supply as data.columns: {U: …}" * ("supply" in needed)
        return f"{name} states {what}", f"drive: {{…, motor: {{{needed}}}}} there{recorded}"

    def si_values(self, unit: str) -> tuple[float, ...]:
        """Return one unit of a length, m, or force, N, along each strut.

        A voltage at the terminals becomes the force of the motor at rest; `Drive.back_emf` is the
        damping in motion. A duty cycle is a share of the supply, or of 1 V if that is recorded.

        Examples
        --------
        >>> units = ActuatorUnits(None, counts_per_metre=(1e6,) * 6, force_constants=(90.0,) * 6)
        >>> [units.si_values(unit)[0] for unit in ("mm", "counts", "kN", "mA")]
        [0.001, 1e-06, 1000.0, 0.09]
        """
        kind, gear = quantity_of_unit(unit), self._drive.geared
        if kind is None or self.missing(unit):
            raise ValueError(f"'{unit}' cannot be converted")
        value, each = kind.parse(f"1 {unit}"), (1.0,) * ACTUATORS
        lead = math.nan if gear is None else gear.travel
        if kind is ANGLE:
            each = (lead / (2 * math.pi),) * ACTUATORS
        elif kind is TORQUE:
            each = (2 * math.pi / lead,) * ACTUATORS
        elif kind is CURRENT:
            each = self.force_constants or self._drive.force_constants or each
        elif kind in VOLTAGE_KINDS:
            each = self._drive.forces_per_volt
            if kind is DUTY and not self.supply_recorded:
                value *= self._drive.supply
        elif kind is COUNT and self.counts_per_metre is not None:
            each = tuple(1 / counts for counts in self.counts_per_metre)
        elif kind is COUNT:
            each = tuple(lead / counts for counts in self.counts_per_revolution or ())
        return tuple(value * one for one in each)
