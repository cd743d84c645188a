"""Live progress of a search on the terminal, and Ctrl-C that ends it with the best so far."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from expdesign.solver import SearchEvent

_HEARTBEAT = 5.0


class SearchDisplay:
    """A monitor that shows every running start and the best so far.

    Parameters
    ----------
    console : rich Console
        On a terminal the display is redrawn in place; elsewhere a line is written when a start
        ends and, at most every five seconds, for the start that moves.
    criterion : str
        What the objective is, in words.
    total : int
        Number of starts and hops.
    larger_is_better : bool
    """

    def __init__(
        self, console: Console, criterion: str, total: int, *, larger_is_better: bool
    ) -> None:
        self._console, self._criterion, self._total = console, criterion, total
        self._sign = 1.0 if larger_is_better else -1.0
        self._running: dict[int, SearchEvent] = {}
        self._best: SearchEvent | None = None
        self._ended = 0
        self._began = self._spoke = time.monotonic()
        self._stop = threading.Event()
        self._live: Live | None = None

    def report(self, event: SearchEvent) -> None:
        """Show one event."""
        if event.phase == "done":
            self._running.pop(event.start, None)
            self._ended += 1
            if math.isfinite(event.objective) and self._improves(event):
                self._best = event
            self._line(_ended(event, self._total))
        else:
            self._running[event.start] = event
            if self._live is None and time.monotonic() - self._spoke > _HEARTBEAT:
                self._line(_running(event))
        if self._live is not None:
            self._live.update(self._picture())

    def stop_requested(self) -> bool:
        """Tell whether the user pressed Ctrl-C."""
        return self._stop.is_set()

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the display, and take Ctrl-C as a request to stop; a second one stops at once."""

        def ask(_number: int, _frame: FrameType | None) -> None:
            if self._stop.is_set():
                raise KeyboardInterrupt
            self._stop.set()
            self._console.print("stopping: the best so far is finished and saved …")

        previous = signal.signal(signal.SIGINT, ask)
        try:
            if self._console.is_terminal:
                with Live(self._picture(), console=self._console, refresh_per_second=4) as live:
                    self._live = live
                    yield
            else:
                yield
        finally:
            self._live = None
            signal.signal(signal.SIGINT, previous)

    def _improves(self, event: SearchEvent) -> bool:
        best = self._best
        return best is None or self._sign * event.objective > self._sign * best.objective

    def _line(self, text: str) -> None:
        self._spoke = time.monotonic()
        self._console.print(text)

    def _picture(self) -> Group:
        table = Table(box=None, pad_edge=False, header_style="dim")
        for title in ("start", "phase", "iteration", self._criterion, "violation", "time"):
            table.add_column(title, justify="right")
        for start in sorted(self._running):
            event = self._running[start]
            table.add_row(
                f"{start}",
                event.phase,
                f"{event.iteration}",
                f"{event.objective:.6g}",
                f"{max(event.violation, 0.0):.1e}",
                f"{event.seconds:.0f} s",
            )
        best = "none yet" if self._best is None else f"{self._best.objective:.6g}"
        seconds = time.monotonic() - self._began
        head = Text(
            f"{self._ended} of {self._total} done, best {self._criterion} {best}, {seconds:.0f} s"
        )
        return Group(head, table)


def _ended(event: SearchEvent, total: int) -> str:
    reached = (
        f"{event.objective:.6g} within the limits"
        if math.isfinite(event.objective)
        else "no usable motion"
    )
    return (
        f"start {event.start}/{total}: {reached} after "
        f"{event.iteration} iterations, {event.seconds:.0f} s: {event.status}"
    )


def _running(event: SearchEvent) -> str:
    return (
        f"start {event.start}: {event.phase}, iteration {event.iteration}, objective "
        f"{event.objective:.6g}, violation {max(event.violation, 0.0):.1e}, {event.seconds:.0f} s"
    )
