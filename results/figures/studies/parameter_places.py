"""Parameters along the horizontal axis, with those of the rigid bodies set apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from results.style import MUTED
from results.symbols import symbol


def parameter_places(axes: Axes, names: Sequence[str]) -> None:
    """Label the axis with the parameters; a line parts rigid bodies from friction."""
    axes.set_xticks(np.arange(len(names)), [symbol(name) for name in names])
    axes.set_xticks(np.arange(len(names) - 1) + 0.5, minor=True)
    axes.tick_params(axis="x", which="both", length=0)
    axes.grid(visible=False, axis="x")
    axes.grid(visible=True, axis="x", which="minor")
    axes.set_xlim(-0.6, len(names) - 0.4)
    rigid = sum(name[0] not in "rv" for name in names)
    if 0 < rigid < len(names):
        axes.axvline(rigid - 0.5, color=MUTED, linewidth=0.9, zorder=1)
