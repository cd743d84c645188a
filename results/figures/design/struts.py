"""What the struts do, against their limits: lengths, speeds, accelerations and forces."""

from __future__ import annotations

from matplotlib.figure import Figure

from results.figures.definition import FigureDefinition
from results.figures.legends import strut_legend
from results.figures.limited_panel import StrutQuantity, limited_panel
from results.record import DesignRecord
from results.style import new_figure

LENGTH = StrutQuantity("Lengths", "Strut length", "m", "strut_length")
SPEED = StrutQuantity("Speeds", "Strut speed", "m/s", "strut_speed")
ACCELERATION = StrutQuantity("Accelerations", "Strut acceleration", "m/s^2", "strut_acceleration")
FORCE = StrutQuantity("Forces", "Actuator force", "N", "actuator_force")


def draw(record: DesignRecord) -> Figure:
    """Draw four panels over one period; the forces are those of the nominal parameters."""
    motion = record.motion
    figure = new_figure(5.4)
    panels = figure.subplots(2, 2, sharex=True)
    contents = (
        (LENGTH, motion.length),
        (SPEED, motion.speed),
        (ACCELERATION, motion.acceleration),
        (FORCE, motion.force),
    )
    for axes, (quantity, values) in zip(panels.flat, contents, strict=True):
        limited_panel(axes, quantity, motion.time, values, record.limit(quantity.limit))
        axes.set_xlim(0, motion.period)
    for axes in panels[-1]:
        axes.set_xlabel("Time (s)")
    figure.align_ylabels()
    strut_legend(figure)
    return figure


FIGURE = FigureDefinition(
    key="struts",
    caption="Lengths, speeds, accelerations and actuator forces (nominal parameters) of the six "
    "struts over one period. What the limits forbid is hatched.",
    draw=draw,
)
