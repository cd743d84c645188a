"""From what was asked for to settings with every default filled in."""

from __future__ import annotations

import numpy as np

from expdesign.configuration import ExportSection
from expdesign.export.axes import ANGLE_UNITS, LENGTH_UNITS, Axes
from expdesign.export.definition import Settings, TableFormat, Task
from expdesign.export.execution import Interpolation
from expdesign.export.formats import table_formats
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES, POSE
from expdesign.robot import Robot

TOLERANCES = {
    Interpolation.LINEAR: 10e-6,
    Interpolation.CUBIC: 1e-6,
    Interpolation.QUINTIC: 1e-6,
}
"""Largest deviation of a strut's length from the design unless one is given, m.

Straight lines between rows 1 ms apart leave a motion of 30 m/s² by 4 µm.
"""

COUNTS = "counts"
_COUNT_DIGITS = 3
_MORE_DIGITS = {"m": 3, "mm": 0, "um": -3, "in": 2}


def settled(section: ExportSection, task: Task) -> Settings:
    """Fill in the defaults of a format."""
    form = table_formats()[section.format]
    axes = _axes(section, form, task.robot)
    digits = section.digits
    if digits is None and form.digits is not None and section.encoding != "mcap":
        more = _MORE_DIGITS[section.units or form.units]
        counted = section.counts_per_metre is not None
        digits = _COUNT_DIGITS if counted else max(0, form.digits + more)
    home = task.motion.sample(0.0).pose
    # What the axes move: the pose itself or the struts' lengths.
    moved = home if axes.space == "pose" else task.robot.inverse_kinematics(home)
    start = axes.rows(np.zeros(1), moved).position[0]
    return Settings(
        section=section,
        form=form,
        name=task.name,
        axes=axes,
        digits=digits,
        step=(section.segment or task.controller_period) if form.uniform else None,
        tolerance=section.tolerance or TOLERANCES[form.interpolation],
        start=start if digits is None else np.round(start, digits),
        window=task.motion.window,
        duration=task.motion.duration,
        sampling=task.sampling,
    )


def _axes(section: ExportSection, form: TableFormat, robot: Robot) -> Axes:
    space = section.coordinates
    names = section.axes or form.axes[space]
    length, angle = section.units or form.units, section.angles or form.angles
    if space == "pose":
        units = [length if one.unit == "m" else angle for one in POSE]
        factor = np.array([(LENGTH_UNITS | ANGLE_UNITS)[unit] for unit in units])
        places, nowhere = np.arange(COORDINATES), np.zeros(COORDINATES)
        return Axes(space, names, tuple(units), places, factor, nowhere, form.fixed_angles)
    source = np.array(section.order or range(1, ACTUATORS + 1), dtype=np.intp) - 1
    scale = np.full(ACTUATORS, LENGTH_UNITS[length])
    if section.counts_per_metre is not None:
        scale, length = np.array(section.counts_per_metre), COUNTS
    if section.offset == "home":
        zero = robot.inverse_kinematics(robot.home)
    else:
        zero = np.zeros(ACTUATORS) if section.offset is None else np.array(section.offset)
    factor = scale * np.array(section.sign or (1,) * ACTUATORS, dtype=float)
    return Axes(space, names, (length,) * ACTUATORS, source, factor[source], zero)
