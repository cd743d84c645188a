"""Progress of a search on the terminal: running starts, and the precision of the best so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from expdesign.cli.activity import Activity, left_text
from expdesign.configuration import RunConfiguration
from expdesign.experiment.precision import precision_in_words
from expdesign.information.criteria import Criterion, criteria
from expdesign.recheck.limit_check import TOLERANCE
from expdesign.solver.phases import PHASE_TITLES, SearchEvent
from expdesign.solver.search import FINISHED, REFINED, groups
from expdesign.solver.starts import GIVEN_UP
from expdesign.trajectory import FourierTrajectory
from results.notation import duration

_ENOUGH = 0.05
"""Share of a search that predicts the rest of its time, with at least one start that has ended."""
_LONGEST = 300.0
"""Longest pause between two lines of a search, s: its log has at most some 40 lines."""
_RENEWED = 1.0
"""Smallest time between two predictions of the best motion's precision, s."""
_TRUE = ("done", "finished")
"""Phases with an objective of the exact (unsmoothed) friction model."""


def search_display(
    console: Console, configuration: RunConfiguration, activity: Activity
) -> SearchDisplay:
    """Return the display of the search that a run describes, within the activity of its stage."""
    section = configuration.run.design
    return SearchDisplay(
        console,
        criteria()[section.criterion],
        section.starts,
        section.hops if section.search == "hopping" else 0,
        partial(precision_in_words, configuration),
        section.max_seconds,
        activity,
    )


class SearchDisplay:
    """Display of every running start and the best so far, with progress and remaining time.

    On a terminal the activity shows its `picture`; elsewhere a line is written from time to time,
    ever more rarely. `describe` returns the predicted precision of a motion in words. `max_seconds`
    are for starts and hops; the finish, which comes on top, is not shown then. The activity is that
    of the stage, for one clock and one count of lines.
    """

    def __init__(
        self,
        console: Console,
        criterion: Criterion,
        starts: int,
        hops: int,
        describe: Callable[[FourierTrajectory], str],
        max_seconds: float | None = None,
        activity: Activity | None = None,
    ) -> None:
        self._console, self._criterion = console, criterion
        self._starts, self._hops = starts, hops
        self._max_seconds = max_seconds or math.inf
        self._describe = describe
        self._running: dict[int, SearchEvent] = {}
        self._best: SearchEvent | None = None
        self._described: SearchEvent | None = None
        self._described_at, self._best_text = -math.inf, ""
        self._rough: set[int] = set()
        self._starts_ended = self._hops_ended = self._refined = self._finished = 0
        self._searches = time.monotonic()
        self._activity = activity or Activity(console, "design")
        self._built = False

    def report(self, event: SearchEvent) -> None:
        """Show one event."""
        self._activity.paused = True
        if not self._built:
            self._built, self._searches = True, time.monotonic()
        if event.phase in _TRUE:
            self._end(event)
        elif event.phase == "waiting":
            self._running.pop(event.start, None)
            self._rough.add(event.start)
        else:
            self._running[event.start] = event
        if self._activity.is_due(longest=_LONGEST):
            self._describe_best()
            self._activity.write_line(f"{self._head}; {self._best_text or self._text(event)}")

    def show_progress(self, what: str, done: int, total: int) -> None:
        """Show the progress before the first start and after the last."""
        self._activity.paused = False
        self._activity.show_progress(what, done, total)

    def _end(self, event: SearchEvent) -> None:
        """Count a start, a hop or a finish that has ended, and write the first result."""
        self._running.pop(event.start, None)
        if finished := event.phase == "finished":
            self._finished += 1
        else:
            hop = event.start > self._starts
            self._starts_ended += not hop
            self._hops_ended += hop
            self._refined += hop or (event.start in self._rough and event.status != GIVEN_UP)
            self._rough |= set() if hop else {event.start}
            if self._best is None and event.motion is not None and not self._console.is_terminal:
                found = f"{self._describe(event.motion)}, within the limits"
                self._activity.write_line(f"{self._head}; {self._name(event)}: {found}")
        # A start that is done is within its limits, the recheck may find a finished one beyond.
        usable = not finished or event.violation <= TOLERANCE
        if usable and math.isfinite(event.objective):
            better = max if self._criterion.larger_is_better else min
            self._best = better(self._best or event, event, key=lambda one: one.objective)
            # A log describes it when a line is due: the precision takes some 40 ms.
            is_due = time.monotonic() - self._described_at > _RENEWED
            if self._console.is_terminal and is_due:
                self._describe_best()

    def _describe_best(self) -> None:
        """Describe the best motion so far, in the thread of the events.

        Another thread, which redraws the display, must not share the model with the search.
        """
        if self._best is not None and self._best.motion and self._best is not self._described:
            self._described, self._described_at = self._best, time.monotonic()
            self._best_text = f"best: {self._describe(self._best.motion)}"

    @property
    def _head(self) -> str:
        """Counts of what has ended, with the time that has passed and the time that is left."""
        hops = f" and {self._hops_ended} of {self._hops} hops" if self._hops else ""
        finished = f", {self._finished} finished" if self._finished else ""
        left = self._left()
        return (
            f"design, {duration(round(self._activity.passed))}: {self._starts_ended} of "
            f"{self._starts} starts{hops} done{finished}{', ' if left else ''}{left}"
        )

    def _text(self, event: SearchEvent) -> str:
        """Return the state of a start, or of all rough searches, in words."""
        if event.status:
            return f"{self._name(event)}: {event.status}"
        if event.phase == "waiting":
            return f"no result yet; {len(self._rough)} of {self._starts} rough searches done"
        return f"no result yet; {self._name(event)}: {_phase(event)}, iteration {_iteration(event)}"

    def _left(self) -> str:
        """Return how long the search will take still; empty while that is not known.

        A rough search counts what refinements, a hop or a finish count.
        """
        finishes = max(min(FINISHED, self._starts + self._hops), self._finished)
        refined = sum(min(REFINED, len(group)) for group in groups(self._starts))
        done = float(len(self._rough) + self._refined + self._finished)
        for number, event in self._running.items():
            rough = number <= self._starts and event.phase == "blunt"
            done += event.share * (event.place[1] if rough else 1)
        share = done / (self._starts + refined + self._hops + finishes)
        if not self._starts_ended or share < _ENOUGH:
            share = 0.0
        passed = time.monotonic() - self._searches
        return left_text(passed, max(share, passed / self._max_seconds))

    def _name(self, event: SearchEvent) -> str:
        """Return the start or hop of an event; hops have the numbers after the starts."""
        if event.start <= self._starts:
            return f"start {event.start} of {self._starts}"
        return f"start {event.start} (hop {event.start - self._starts} of {self._hops})"

    def picture(self) -> Group:
        """Return the running starts and the best so far."""
        if not self._built:
            return Group(Text(self._activity.line))
        lines = [Text(self._head), Text(self._best_text or "best: none yet")]
        if not self._running:
            return Group(*lines, Text(self._activity.line))
        table = Table(box=None, pad_edge=False, header_style="dim")
        for title in ("start", "stage", "iteration", "limits", "time"):
            text = title in ("stage", "limits")
            table.add_column(title, justify="left" if text else "right", no_wrap=True)
        for start, event in sorted(self._running.copy().items()):
            table.add_row(
                f"{start}",
                _phase(event),
                _iteration(event),
                f"{100 * event.violation:.2g} % beyond" if event.violation > 0 else "kept",
                duration(round(event.seconds)),
            )
        return Group(*lines, table)


def _phase(event: SearchEvent) -> str:
    """Return the phase of a start in words."""
    number, count = event.place
    title = PHASE_TITLES.get(event.phase, event.phase)
    return f"{title} ({number} of {count})" if count > 1 else title


def _iteration(event: SearchEvent) -> str:
    number, most = event.of_round
    return f"{number} of {most}" if most else f"{event.iteration}"
