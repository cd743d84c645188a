"""Progress of what is done many times over."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from expdesign.cli.output import messages

_HEARTBEAT = 5.0


def counted(numbers: range, what: str) -> Iterator[int]:
    """Go through the numbers and show how far it is, on standard error.

    A terminal gets a bar; elsewhere a line is written, at most every five seconds. A single number
    is not worth a word.

    Parameters
    ----------
    numbers : range
    what : str
        What they count, in the plural.
    """
    total, console = len(numbers), messages()
    if total > 1 and console.is_terminal:
        from rich.progress import track

        yield from track(numbers, description=what, total=total, console=console, transient=True)
        return
    spoke = time.monotonic()
    for done, number in enumerate(numbers):
        if time.monotonic() - spoke > _HEARTBEAT:
            console.print(f"{done} of {total} {what}")
            spoke = time.monotonic()
        yield number


class StudyDisplay:
    """Shows how many are done, and takes Ctrl-C as a request to stop.

    Parameters
    ----------
    console : rich Console
        A terminal gets a bar; elsewhere a line is written, at most every five seconds.
    what : str
        What is counted, in the plural.
    """

    def __init__(self, console: Console, what: str) -> None:
        self._console, self._what = console, what
        self._spoke = time.monotonic()
        self._stop = threading.Event()
        self._bar = Progress(
            TextColumn(what),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task = self._bar.add_task(what, total=None)

    def advanced(self, done: int, total: int) -> None:
        """Show how far it is."""
        self._bar.update(self._task, completed=done, total=total)
        if not self._console.is_terminal and time.monotonic() - self._spoke > _HEARTBEAT:
            self._console.print(f"{done} of {total} {self._what}")
            self._spoke = time.monotonic()

    def stop_requested(self) -> bool:
        """Tell whether the user pressed Ctrl-C."""
        return self._stop.is_set()

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the display; a second Ctrl-C stops at once."""

        def ask(_number: int, _frame: FrameType | None) -> None:
            if self._stop.is_set():
                raise KeyboardInterrupt
            self._stop.set()
            self._console.print(f"stopping: the {self._what} that are done are kept …")

        previous = signal.signal(signal.SIGINT, ask)
        try:
            if self._console.is_terminal:
                with self._bar:
                    yield
            else:
                yield
        finally:
            signal.signal(signal.SIGINT, previous)
