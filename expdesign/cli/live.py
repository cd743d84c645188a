"""Live progress of a search on the terminal, and Ctrl-C that ends it with the best so far."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from expdesign.recheck import TOLERANCE
from expdesign.solver import SearchEvent

_HEARTBEAT = 5.0
_BUILDING = "building the problem"
_STOPPING = (
    "stopping: if a start has a result by now, the best so far is finished and saved; "
    "Ctrl-C again abandons the design …"
)
_ABANDONED = "abandoned: nothing of this design is saved"


_TRUE = ("done", "finished")
"""Phases whose objective is by the unsmoothed model."""


@dataclass(frozen=True)
class Objective:
    """What the numbers of a search are.

    Attributes
    ----------
    title : str
        The criterion in words.
    blunt_title : str
        What the blunt stage optimises, in words; the same or another criterion.
    larger_is_better : bool
        Of the criterion.
    """

    title: str
    blunt_title: str
    larger_is_better: bool

    def of(self, event: SearchEvent) -> str:
        """Return an event's objective with its name: criterion, and smoothed or true."""
        title = self.blunt_title if event.phase == "blunt" else self.title
        model = "true" if event.phase in _TRUE else "smoothed"
        return f"{title} {event.objective:.6g} ({model})"


class SearchDisplay:
    """A monitor that shows every running start and the best so far.

    Parameters
    ----------
    console : rich Console
        On a terminal the display is redrawn in place; elsewhere a line is written when a start
        ends and, at most every five seconds, for the start that moves.
    objective : Objective
    total : int
        Number of starts and hops.
    """

    def __init__(self, console: Console, objective: Objective, total: int) -> None:
        self._console, self._objective, self._total = console, objective, total
        self._running: dict[int, SearchEvent] = {}
        self._best: SearchEvent | None = None
        self._ended = 0
        self._began = self._spoke = time.monotonic()
        self._built = False
        self._stop = threading.Event()
        self._live: Live | None = None

    def report(self, event: SearchEvent) -> None:
        """Show one event."""
        if not self._built:
            self._built = True
            self._line(f"built after {self._seconds:.0f} s; the search begins")
        if event.phase in _TRUE:
            self._running.pop(event.start, None)
            self._ended += event.phase == "done"
            # What is done is shrunk into its limits; what is finished may break one by the recheck.
            kept = event.phase == "done" or event.violation <= TOLERANCE
            if kept and math.isfinite(event.objective) and self._improves(event):
                self._best = event
            self._line(self._ended_text(event))
        else:
            self._running[event.start] = event
            if self._live is None and time.monotonic() - self._spoke > _HEARTBEAT:
                self._line(self._running_text(event))

    def stop_requested(self) -> bool:
        """Tell whether the user pressed Ctrl-C."""
        return self._stop.is_set()

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the display, and take Ctrl-C as a request to stop; a second one stops at once."""

        def ask(_number: int, _frame: FrameType | None) -> None:
            if self._stop.is_set():
                self._console.print(_ABANDONED)
                raise KeyboardInterrupt
            self._stop.set()
            self._console.print(_STOPPING)

        previous = signal.signal(signal.SIGINT, ask)
        self._began = time.monotonic()
        try:
            if self._console.is_terminal:
                with Live(
                    get_renderable=self._picture, console=self._console, refresh_per_second=4
                ) as live:
                    self._live = live
                    yield
            else:
                self._line(f"{_BUILDING} …")
                yield
        finally:
            self._live = None
            signal.signal(signal.SIGINT, previous)

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    def _improves(self, event: SearchEvent) -> bool:
        if self._best is None:
            return True
        larger = event.objective > self._best.objective
        return larger is self._objective.larger_is_better

    def _line(self, text: str) -> None:
        self._spoke = time.monotonic()
        self._console.print(text)

    def _picture(self) -> Group:
        if not self._built:
            return Group(Text(f"{_BUILDING}, {self._seconds:.0f} s"))
        table = Table(box=None, pad_edge=False, header_style="dim")
        for title in ("start", "stage", "iteration", "objective", "violation", "time"):
            table.add_column(title, justify="right")
        for start, event in sorted(self._running.copy().items()):
            table.add_row(
                f"{start}",
                event.phase,
                f"{event.iteration}",
                self._objective.of(event),
                f"{max(event.violation, 0.0):.1e}",
                f"{event.seconds:.0f} s",
            )
        best = "none yet" if self._best is None else self._objective.of(self._best)
        head = Text(f"{self._ended} of {self._total} done, best: {best}, {self._seconds:.0f} s")
        return Group(head, table)

    def _ended_text(self, event: SearchEvent) -> str:
        if event.phase == "finished":
            return f"start {event.start}, finished: {self._objective.of(event)}, {event.status}"
        effort = f"{event.iteration} iterations, {event.seconds:.0f} s"
        start = f"start {event.start}/{self._total}"
        if not math.isfinite(event.objective):
            return f"{start}: {event.status} ({effort})"
        reached = f"{self._objective.of(event)} within the limits"
        return f"{start}: {reached} after {effort}: {event.status}"

    def _running_text(self, event: SearchEvent) -> str:
        return (
            f"start {event.start}: {event.phase}, iteration {event.iteration}, "
            f"{self._objective.of(event)}, violation {max(event.violation, 0.0):.1e}, "
            f"{event.seconds:.0f} s"
        )
