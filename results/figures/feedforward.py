"""How well a motion is followed, feed-forward by feed-forward."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimation.feedforward.result import MEANINGS, CaseName, FeedforwardResult
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures.drawing import figure_definition, named_places, plain_decades
from results.notation import handy_unit
from results.style import BLUE, GREEN, GREY, ORANGE, VERMILLION

_COLOURS: dict[CaseName, str] = {
    "none": GREY,
    "gravity": ORANGE,
    "nominal": VERMILLION,
    "identified": BLUE,
    "true": GREEN,
}


@figure_definition(
    "feedforward",
    "Error of the position over one period under the same controller, feed-forward by "
    "feed-forward. Above: distance of the TCP from its place; below: rms error of each strut.",
    height=5.0,
)
def feedforward_figure(figure: Figure, record: FeedforwardResult) -> None:
    """Draw the TCP's error over time, and the rms errors of the struts."""
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    cases = [each.case for each in record.cases]
    unit = handy_unit("m", [each.max_position for each in record.cases])
    for case, tracking in zip(cases, record.tracking, strict=True):
        look = {"linestyle": (0, (2, 1.5))} if case == "true" else {}
        above.plot(
            tracking.time,
            unit.shown(tracking.position),
            color=_COLOURS[case],
            linewidth=0.9,
            **look,
        )
    above.set_yscale("log")
    plain_decades(above.yaxis)
    above.set_xlim(0, record.tracking[0].time[-1])
    above.set_xlabel("Time (s)")
    above.set_ylabel(unit.label("Error of the TCP"))
    struts = handy_unit("m", [row.rms for row in record.rows])
    width = 0.5 / len(cases)
    for place, case in enumerate(cases):
        sizes = [row.rms for row in record.rows if row.case == case]
        middle = np.arange(ACTUATORS) + (place - (len(cases) - 1) / 2) * width
        below.plot(middle, struts.shown(sizes), "o", color=_COLOURS[case], markersize=4.5)
    below.set_yscale("log")
    plain_decades(below.yaxis)
    named_places(below, [f"strut {j}" for j in range(1, ACTUATORS + 1)])
    below.set_ylabel(struts.label("Rms error"))
    handles = [
        Line2D([], [], color=_COLOURS[case], linewidth=2.0, label=MEANINGS[case]) for case in cases
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
