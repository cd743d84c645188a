"""Progress and results of a run on the terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from expdesign.cli import shown
from expdesign.cli.output import messages, note, warn
from expdesign.stages.outcome import Outcome, Progress

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration
    from expdesign.information.spectral import Criterion
    from expdesign.solver.stage import SearchEvent

_HEARTBEAT = 5.0
"""Seconds between two lines, at least, where nothing can be redrawn in place."""

_TRUE = ("done", "finished")
"""Phases whose objective is by the unsmoothed model."""


class Terminal(Progress):
    """Shows progress and remarks on standard error, results on standard output.

    Parameters
    ----------
    quiet : bool
        Whether results are left out, since the command writes them as JSON.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet

    def warn(self, text: str) -> None:
        """Write a warning."""
        warn(text)

    def note(self, text: str) -> None:
        """Write a remark."""
        note(text)

    def finished(self, outcome: Outcome) -> None:
        """Print what a stage has made."""
        if not self._quiet:
            getattr(shown, outcome.stage)(outcome)

    @contextmanager
    def search(self, configuration: RunConfiguration) -> Iterator[Callable[[SearchEvent], None]]:
        """Show every running start and the best so far."""
        from expdesign.information.criteria import CRITERIA

        section = configuration.run.design
        total = section.starts + (section.hops if section.search == "hopping" else 0)
        display = SearchDisplay(messages(), CRITERIA[section.criterion], total)
        with display.shown():
            yield display.report

    @contextmanager
    def count(self, what: str) -> Iterator[Callable[[int, int], None]]:
        """Show a bar; elsewhere than on a terminal a line, at most every five seconds."""
        console, began = messages(), time.monotonic()
        columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        bar = Bar(*columns, console=console, transient=True, disable=not console.is_terminal)
        task = bar.add_task(what, total=None)
        spoke = began

        def advanced(done: int, total: int) -> None:
            nonlocal spoke
            bar.update(task, completed=done, total=total)
            if not console.is_terminal and time.monotonic() - spoke > _HEARTBEAT:
                console.print(f"{done} of {total} {what}")
                spoke = time.monotonic()

        with bar:
            yield advanced


class SearchDisplay:
    """Shows every running start and the best so far.

    Parameters
    ----------
    console : rich Console
        On a terminal the display is redrawn in place; elsewhere a line is written when a start
        ends and, at most every five seconds, for the start that moves.
    criterion : Criterion
    total : int
        Number of starts and hops.
    """

    def __init__(self, console: Console, criterion: Criterion, total: int) -> None:
        self._console, self._criterion, self._total = console, criterion, total
        self._running: dict[int, SearchEvent] = {}
        self._best: SearchEvent | None = None
        self._ended = 0
        self._began = self._spoke = time.monotonic()
        self._built = False

    def report(self, event: SearchEvent) -> None:
        """Show one event."""
        from expdesign.recheck.judge import TOLERANCE

        if not self._built:
            self._built = True
            self._line(f"built after {self._seconds:.0f} s; the search begins")
        if event.phase in _TRUE:
            self._running.pop(event.start, None)
            self._ended += event.phase == "done"
            # What is done is shrunk into its limits; what is finished may break one by the recheck.
            kept = event.phase == "done" or event.violation <= TOLERANCE
            if kept and math.isfinite(event.objective):
                best = self._best or event
                better = max if self._criterion.larger_is_better else min
                self._best = better(best, event, key=lambda one: one.objective)
            self._line(self._ended_text(event))
        else:
            self._running[event.start] = event
            if not self._console.is_terminal and time.monotonic() - self._spoke > _HEARTBEAT:
                self._line(
                    f"start {event.start}: {event.phase}, iteration {event.iteration}, "
                    f"{self._objective(event)}, violation {max(event.violation, 0.0):.1e}, "
                    f"{event.seconds:.0f} s"
                )

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the display."""
        if self._console.is_terminal:
            with Live(get_renderable=self._picture, console=self._console, refresh_per_second=4):
                yield
        else:
            self._line("building the problem …")
            yield

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    def _objective(self, event: SearchEvent) -> str:
        """Return an event's objective with its name: criterion, and smoothed or true."""
        from expdesign.information.criteria import CRITERIA

        # The blunt stage of a criterion that is flat far off is that of log det F.
        of_d = event.phase == "blunt" and self._criterion.flat
        title = (CRITERIA["d"] if of_d else self._criterion).title
        model = "true" if event.phase in _TRUE else "smoothed"
        return f"{title} {event.objective:.6g} ({model})"

    def _line(self, text: str) -> None:
        self._spoke = time.monotonic()
        self._console.print(text)

    def _picture(self) -> Group:
        if not self._built:
            return Group(Text(f"building the problem, {self._seconds:.0f} s"))
        table = Table(box=None, pad_edge=False, header_style="dim")
        for title in ("start", "stage", "iteration", "objective", "violation", "time"):
            table.add_column(title, justify="right")
        for start, event in sorted(self._running.copy().items()):
            table.add_row(
                f"{start}",
                event.phase,
                f"{event.iteration}",
                self._objective(event),
                f"{max(event.violation, 0.0):.1e}",
                f"{event.seconds:.0f} s",
            )
        best = "none yet" if self._best is None else self._objective(self._best)
        head = Text(f"{self._ended} of {self._total} done, best: {best}, {self._seconds:.0f} s")
        return Group(head, table)

    def _ended_text(self, event: SearchEvent) -> str:
        if event.phase == "finished":
            return f"start {event.start}, finished: {self._objective(event)}, {event.status}"
        effort = f"{event.iteration} iterations, {event.seconds:.0f} s"
        start = f"start {event.start}/{self._total}"
        if not math.isfinite(event.objective):
            return f"{start}: {event.status} ({effort})"
        reached = f"{self._objective(event)} within the limits"
        return f"{start}: {reached} after {effort}: {event.status}"
