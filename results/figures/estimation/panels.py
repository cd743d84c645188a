"""Six panels, one for each strut."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from results.style import MUTED


def strut_panels(
    figure: Figure, title: str, shape: tuple[int, int] = (2, 3), *, share: bool
) -> tuple[Axes, ...]:
    """Return the panels of struts 1 … 6, titled; `share`: with common axes."""
    panels = figure.subplots(*shape, sharex=share, sharey=share, squeeze=False)
    for number, axes in enumerate(panels.flat, 1):
        axes.set_title(f"{title} {number}")
    return tuple(panels.flat)


def corner_text(axes: Axes, text: str) -> None:
    """Write small text into the upper right corner."""
    axes.text(
        0.985,
        0.97,
        text,
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize="small",
        color=MUTED,
        linespacing=1.25,
    )
