"""Progress of an activity on the terminal: a bar, or a line from time to time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from results.notation import duration

HEARTBEAT = 10.0
"""Seconds between two lines, at least, where nothing can be redrawn in place."""
GROWTH, LONGEST = 1.5, 60.0
"""A pause as a share of the time that had passed before it, up to so many seconds: the number of
lines hardly depends on the load of the machine."""
_UNCHANGED = 60.0
"""Seconds between two lines, at least, that state the same progress."""
_CHECKED = 1.0
"""Seconds between two checks whether a line is due."""
_SILENT = 2.0
"""Seconds that pass before anything is shown."""
_BAR = 16
_MINUTE = 60


def left_text(passed: float, share: float, waited: float = 0.0) -> str:
    """Return the remaining time, from the time for a share of the whole; empty: unknown.

    The share was reached `waited` seconds ago. A step that takes longer makes the time unknown.
    """
    if not 0 < share < 1 or passed < _SILENT:
        return ""
    left = passed * (1 - share) / share - waited
    if left <= 0:
        return ""
    # An estimate: its seconds mean nothing.
    if left > _MINUTE:
        left = 5 * round(left / 5)
    return f"about {duration(round(left))} left"


class Activity:
    """Display of the progress of a stage by its name, and of the search in it."""

    def __init__(self, console: Console, name: str) -> None:
        self._console, self._name = console, name
        self._what, self._done, self._total, self._first = "", 0, 0, 0
        self._began = self._since = self._stepped = time.monotonic()
        self._spoke: float | None = None
        self._shown: tuple[str, int] | None = None
        self._spinner = Spinner("dots")
        self._picture: Callable[[], RenderableType] = self._bar
        self._lock = Lock()
        self.paused = False

    def show_progress(self, what: str, done: int, total: int) -> None:
        """Show the number of finished items of `what`."""
        if what != self._what:
            # Items of an earlier run are not part of the time.
            self._what, self._since, self._first = what, time.monotonic(), done
            self._stepped = self._since
        elif done != self._done:
            self._stepped = time.monotonic()
        self._done, self._total = done, total
        self._write_due_line()

    def _write_due_line(self) -> None:
        if self.paused or not self._what:
            return
        with self._lock:
            state = self._what, self._done
            if self.is_due(_UNCHANGED if self._shown == state else HEARTBEAT):
                self.write_line(self.line)
                self._shown = state

    def is_due(self, pause: float | None = None, longest: float | None = None) -> bool:
        """Return whether a line is due; pauses grow with the time that has passed."""
        if self._console.is_terminal:
            return False
        now = time.monotonic()
        if self._spoke is None:
            return now - self._began > _SILENT
        most = LONGEST if longest is None else longest
        growing = min(GROWTH * (self._spoke - self._began), most)
        return now - self._spoke > max(HEARTBEAT if pause is None else pause, growing)

    def write_line(self, text: str) -> None:
        """Write a line now; the next one is due after a pause."""
        self._spoke = time.monotonic()
        self._console.print(text)

    @property
    def passed(self) -> float:
        """Time since the stage began, s."""
        return time.monotonic() - self._began

    @property
    def line(self) -> str:
        """Activity, progress and remaining time."""
        now = time.monotonic()
        counted = f", {self._done} of {self._total}" if self._total else ""
        share = 0.0
        if self._total > self._first:
            share = (self._done - self._first) / (self._total - self._first)
        left = left_text(self._stepped - self._since, share, now - self._stepped)
        what = f": {self._what}" if self._what else ""
        rest = f" ({left})" if left else ""
        return f"{self._name}, {duration(round(self.passed))}{what}{counted}{rest}"

    @contextmanager
    def display(self) -> Iterator[None]:
        """Show the progress on a terminal until the stage is done, and then remove it."""
        if not self._console.is_terminal:
            with self._lines_while_lasting():
                yield
            return
        with Live(self, console=self._console, transient=True, refresh_per_second=8):
            yield

    @contextmanager
    def _lines_while_lasting(self) -> Iterator[None]:
        """Write lines also while nothing reports, such as during a compilation."""
        ended = Event()

        def write() -> None:
            while not ended.wait(_CHECKED):
                self._write_due_line()

        thread = Thread(target=write, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def __rich__(self) -> RenderableType:
        """Return what is shown at present."""
        return self._picture()

    @contextmanager
    def show_instead(self, picture: Callable[[], RenderableType]) -> Iterator[None]:
        """Replace the bar by another picture."""
        self._picture = picture
        try:
            yield
        finally:
            self._picture, self.paused = self._bar, False

    def _bar(self) -> RenderableType:
        if time.monotonic() - self._began < _SILENT:
            return Text("")
        row = Table.grid(padding=(0, 1))
        row.add_column(no_wrap=True)
        row.add_column(no_wrap=True)
        row.add_column(no_wrap=True, overflow="ellipsis")
        bar = ProgressBar(
            total=self._total or None, completed=self._done, width=_BAR, pulse=not self._total
        )
        row.add_row(self._spinner, bar, Text(self.line))
        return row
