"""The excitation over one period: displacements above, rotation angles below."""

from __future__ import annotations

from matplotlib.figure import Figure

from expdesign.experiment import DesignRecord
from expdesign.mechanism.hexapod import COORDINATE_NAMES
from results.figures.drawing import FigureDefinition, legend_above
from results.style import AXIS_COLOURS, AXIS_DASHES, MUTED, new_figure
from results.symbols import symbol
from results.units import handy_unit

_PANELS = (
    ("Displacements of the TCP from home", "Displacement", "m", slice(0, 3)),
    ("Rotation angles", "Angle", "rad", slice(3, 6)),
)


def draw(record: DesignRecord) -> Figure:
    """Draw x, y, z from home and φ, θ, ψ, as Fig. 2 of the paper does."""
    figure = new_figure(4.4)
    panels = figure.subplots(2, 1, sharex=True)
    time = record.motion.time
    # Where home is belongs to the place of the robot; angles are shown as they are limited.
    origin = record.robot.home * [1, 1, 1, 0, 0, 0]
    values = record.motion.pose - origin
    for axes, (title, label, si, part) in zip(panels, _PANELS, strict=True):
        unit = handy_unit(si, values[:, part])
        axes.axhline(0, color=MUTED, linewidth=0.7, zorder=1)
        names = COORDINATE_NAMES[part]
        for k, (name, colour, dashes) in enumerate(
            zip(names, AXIS_COLOURS, AXIS_DASHES, strict=True)
        ):
            shown = unit.shown(values[:, part][:, k])
            axes.plot(time, shown, color=colour, linestyle=dashes, label=symbol(name))
        axes.set_title(title)
        axes.set_ylabel(unit.label(label))
        axes.set_xlim(0, record.motion.period)
        legend_above(axes, axes.get_lines()[1:])
    panels[-1].set_xlabel("Time (s)")
    figure.align_ylabels()
    return figure


FIGURE = FigureDefinition(
    key="excitation",
    caption="One period of the excitation trajectory: displacements of the tool centre point from "
    "the home pose (above) and rotation angles of the platform (below).",
    draw=draw,
)
