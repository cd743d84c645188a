"""The output that is on in the measurement window, in formats that can switch one.

A controller switches it when the next move begins. The command therefore stands behind the row at
whose time it takes effect.
"""

from __future__ import annotations

from collections.abc import Sequence

from constraints.arrays import Array
from expdesign.export.definition import Rows, Settings, TableError, edge_rows


def switching(rows: Rows, settings: Settings, commands: tuple[str, str]) -> dict[int, str]:
    """Return the commands that switch the output on and off, by the row behind which they stand.

    Without a trigger there are none.
    """
    if settings.section.trigger is None:
        return {}
    return dict(zip(edge_rows(rows.times, settings.window), commands, strict=True))


def switched_at(found: Sequence[tuple[int, bool]], times: Array) -> tuple[float, float] | None:
    """Return when the output is on, s; None where it is never switched.

    Parameters
    ----------
    found : sequence of (int, bool)
        The row behind which each command stands, and whether it switches the output on.
    times : (N,)
        Of the rows, s.
    """
    if not found:
        return None
    rows = [row for row, _ in found]
    if [on for _, on in found] != [True, False] or not 0 <= rows[0] < rows[1] < len(times) - 1:
        raise TableError("the output is not switched on once and off once, each before a move")
    return float(times[rows[0]]), float(times[rows[1]])
