"""Legends that stand beside the data, never over them."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from results.style import STRUT_COLOURS


def strut_legend(figure: Figure) -> None:
    """Name the six strut colours above all panels."""
    handles = [
        Line2D([], [], color=colour, linewidth=2.0, label=f"strut {j}")
        for j, colour in enumerate(STRUT_COLOURS, 1)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))


def legend_above(axes: Axes, handles: Sequence[Artist | Container]) -> None:
    """Put a panel's legend on its upper edge, at the right end of the title's line.

    Parameters
    ----------
    axes : Axes
    handles : sequence of Artist or Container
        With their labels.
    """
    axes.legend(
        handles=list(handles),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=max(1, len(handles)),
        borderaxespad=0.25,
    )
