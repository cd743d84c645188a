"""Progress and results of a run on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from expdesign.cli.activity import Activity
from expdesign.cli.output import messages, note, results, warn
from expdesign.configuration import RunConfiguration
from expdesign.progress import Listener, listen_to_progress
from expdesign.stages.stage import Outcome, Progress, short
from results.render.terminal import brief_warnings, print_view

if TYPE_CHECKING:
    from expdesign.solver.phases import SearchEvent


class Terminal(Progress):
    """Listener that shows progress and remarks on standard error, results on standard output.

    A quiet one leaves out the results, since the command writes them as JSON.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        # One console for all: lines that are written while a bar is shown go above it.
        self._console = messages()
        self._activity: Activity | None = None

    def warn(self, text: str) -> None:
        """Write a warning."""
        warn(text, self._console)

    def note(self, text: str) -> None:
        """Write a remark."""
        note(text, self._console)

    def show(self, outcome: Outcome) -> None:
        """Print the view of a stage's result, then its warnings."""
        console, view, warnings = results(), outcome.view, outcome.warnings
        if not self._quiet and view is not None:
            if console.is_terminal:  # logs keep whole warnings
                warnings = tuple(brief_warnings(view, warnings, console.width))
            print_view(view, console, short(outcome.folder), below=len(warnings))
        for warning in warnings:
            self.warn(warning)

    @contextmanager
    def working(self, what: str) -> Iterator[Listener]:
        """Show a bar; elsewhere than on a terminal a line, at growing intervals."""
        self._activity = Activity(self._console, what)
        try:
            with self._activity.display():
                yield self._activity.show_progress
        finally:
            self._activity = None

    @contextmanager
    def search(self, configuration: RunConfiguration) -> Iterator[Callable[[SearchEvent], None]]:
        """Show every running start and the best so far."""
        # A command that refuses its input needs no search.
        from expdesign.cli.search_display import search_display

        activity = self._activity or Activity(self._console, "design")
        display = search_display(self._console, configuration, activity)
        with activity.show_instead(display.picture), listen_to_progress(display.show_progress):
            yield display.report


@contextmanager
def working(what: str) -> Iterator[Terminal]:
    """Show the progress of a command that is not a stage."""
    terminal = Terminal()
    with terminal.working(what) as listener, listen_to_progress(listener):
        yield terminal
