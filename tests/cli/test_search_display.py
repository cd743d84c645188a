"""The progress of a search: what the numbers are."""

import dataclasses
import io
import time

import pytest
from rich.console import Console

from expdesign.cli.activity import Activity
from expdesign.cli.search_display import SearchDisplay
from expdesign.information.criteria import criteria
from expdesign.solver.phases import PHASE_TITLES, SearchEvent

CONDITION = dataclasses.replace(criteria()["condition"], flat=True)


@pytest.fixture
def display():
    console = Console(file=io.StringIO(), width=200, soft_wrap=True)
    return SearchDisplay(console, CONDITION, 3, 0, "mass ± {} %".format)


@pytest.fixture
def every_line(monkeypatch):
    for name in ("activity.HEARTBEAT", "activity.LONGEST", "activity._SILENT"):
        monkeypatch.setattr(f"expdesign.cli.{name}", -1.0)
    monkeypatch.setattr("expdesign.cli.search_display._LONGEST", -1.0)


class Clock:
    now = 100.0

    def monotonic(self):
        return self.now


def said(display):
    return display._console.file.getvalue()


def event(phase, objective, status="", violation=1e-3, **more):
    return SearchEvent(1, phase, 7, objective, violation, 2.0, status, **more)


def test_there_is_a_line_before_the_first_event(display, every_line):
    with display._activity.display():
        display.show_progress("building the problem", 0, 0)
        assert len(said(display).splitlines()) == 1
        display.report(event("blunt", 90.0))
        assert len(said(display).splitlines()) == 2


def test_what_lasts_before_the_search_is_named_although_nothing_reports(display, monkeypatch):
    """Such as a compilation right after short trial motions."""

    clock = Clock()
    monkeypatch.setattr("expdesign.cli.activity.time", clock)
    monkeypatch.setattr("expdesign.cli.activity._CHECKED", 0.01)
    display = SearchDisplay(display._console, CONDITION, 3, 0, "mass ± {} %".format)
    with display._activity.display():
        display.show_progress("trial motions", 0, 3)
        display.show_progress("compiling", 0, 5)
        clock.now += 30.0
        deadline = time.monotonic() + 60
        while "compiling" not in said(display) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert said(display).splitlines()[-1] == "design, 30 s: compiling, 0 of 5"
        display.report(event("blunt", 90.0))
        count = len(said(display).splitlines())
        clock.now += 300.0
        time.sleep(0.2)
        assert len(said(display).splitlines()) == count, "the search has lines of its own"


def test_a_search_is_described_in_the_words_of_a_user(display, every_line):
    """Before the first result as after it, in lines and in the table: no values of a criterion."""
    display.report(event("blunt", 90.5, place=(1, 3), of_round=(7, 80)))
    display.report(event("sharp", 1234.0, place=(3, 3), of_round=(2, 20), violation=0.0))
    console = Console(file=io.StringIO(), width=100)
    console.print(display.picture())
    display.report(event("waiting", 1240.0))
    display.report(event("done", float("inf"), "given up: behind"))
    display.report(event("done", 1300.0, "converged", motion=4))
    display.report(event("finished", 1250.0, "every limit kept", violation=-1e-5, motion=2))
    blunt, sharp, waiting, given_up, first, done, last = said(display).splitlines()
    assert PHASE_TITLES["blunt"] in blunt
    assert blunt.endswith("iteration 7 of 80")
    assert PHASE_TITLES["sharp"] in sharp
    assert sharp.endswith("2 of 20")
    assert waiting.endswith("no result yet; 1 of 3 rough searches done")
    assert "given up: behind" in given_up
    assert "start 1 of 3: mass ± 4 %, within the limits" in first
    assert done.endswith("best: mass ± 4 %")
    assert last.endswith("best: mass ± 2 %")
    assert "1 finished" in last
    texts = said(display) + console.file.getvalue()
    assert "limits" in console.file.getvalue()
    for word in (
        "90.5",
        "1234",
        "1240",
        "1300",
        "1250",
        "condition",
        "log det",
        "smoothed",
        "objective",
    ):
        assert word not in texts
    assert display._starts_ended == 2
    assert display._best.objective == 1250


def test_the_best_is_the_smallest_of_a_criterion_that_is_minimised(display):
    for value in (1300.0, 1200.0, float("inf"), 1250.0):
        display.report(event("done", value))
    assert display._best.objective == 1200


def test_the_best_is_described_by_its_precision(display, every_line):
    display.report(event("done", 1300.0, "converged", motion=2))
    display.report(event("done", 1400.0, "converged", motion=3))
    display.report(event("finished", 1200.0, "every limit kept", violation=0.0, motion=1))
    first, *others = said(display).splitlines()
    assert "mass ± 2 %, within the limits" in first
    assert [line.split("best: ")[-1] for line in others] == [
        "mass ± 2 %",
        "mass ± 2 %",
        "mass ± 1 %",
    ]


def test_what_breaks_a_limit_is_never_the_best(display):
    display.report(event("done", 1300.0))
    display.report(event("finished", 1200.0, "a limit is broken", violation=2e-6))
    assert display._best.objective == 1300
    display.report(event("finished", 1250.0, "every limit kept", violation=0.0))
    assert display._best.objective == 1250


def test_the_time_left_counts_what_is_under_way_and_the_finish(display, monkeypatch):
    """Three rough searches, three refinements and three finishes: 9.

    Two rough searches, and a refinement with half of another: 3.5.
    """
    display.report(event("blunt", 90.0, share=0.9, place=(1, 3)))
    monkeypatch.setattr(display, "_searches", display._searches - 10.0)
    assert not display._left()  # nothing has ended yet
    for start in (1, 2):
        display.report(dataclasses.replace(event("waiting", 100.0), start=start))
    assert not display._left()  # no start has a result yet
    display.report(event("done", 1300.0, "converged"))
    display.report(dataclasses.replace(event("sharp", 1300.0, share=0.5, place=(2, 3)), start=2))
    began = display._searches
    monkeypatch.setattr("expdesign.cli.search_display.time.monotonic", lambda: began + 14.0)
    assert "22 s" in display._left()


def test_what_waits_for_others_is_not_shown_as_running(display):
    display.report(event("blunt", 90.0, place=(1, 3)))
    display.report(event("waiting", 100.0))
    assert not display._running
    assert display._starts_ended == 0


def test_hops_are_counted_as_hops(every_line):
    console = Console(file=io.StringIO(), width=200)
    display = SearchDisplay(console, CONDITION, 2, 5, "mass ± {} %".format)
    for number in (1, 2, 3, 4, 5):
        display.report(dataclasses.replace(event("done", 1300.0), start=number))
    display.report(dataclasses.replace(event("finished", 1200.0, violation=0.0), start=5))
    assert "3 of 5 hops done, 1 finished" in said(display).splitlines()[-1]
    console.print(display.picture())
    assert "2 of 2 starts and 3 of 5 hops" in said(display)


def test_a_table_of_the_running_starts_fits_into_80_columns(display):
    console = Console(file=io.StringIO(), width=80)
    for number in (1, 12):
        running = event("sharp", -1234.56, place=(2, 3), of_round=(79, 80), share=0.6)
        display.report(dataclasses.replace(running, start=number, seconds=754.0))
    console.print(display.picture())
    assert "…" not in console.file.getvalue()
    assert "79 of 80" in console.file.getvalue()


@pytest.mark.parametrize(("slower", "most"), [(1, 4), (12, 5), (120, 27)])
def test_a_log_is_as_short_on_a_loaded_machine(slower, most, monkeypatch):
    """A search of half a minute, also where it takes six minutes or an hour: one clock."""
    clock = Clock()
    monkeypatch.setattr("expdesign.cli.activity.time", clock)
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "design")
    clock.now += slower
    activity.show_progress("loading modules", 0, 0)
    display = SearchDisplay(console, CONDITION, 24, 0, "mass ± {} %".format, activity=activity)
    for what in ("building the problem", "proving the limits"):
        for step in range(100):
            clock.now += 0.05 * slower
            display.show_progress(what, step, 100)
        for number in range(190):
            clock.now += 0.05 * slower
            phase = "done" if number % 8 == 7 else "blunt"
            display.report(event(phase, 1300.0, "converged" * (phase == "done"), motion=3))
    lines = console.file.getvalue().splitlines()
    assert 3 <= len(lines) <= most
    times = [line.split(": ")[0].removeprefix("design, ") for line in lines]
    assert all(line.startswith("design, ") for line in lines)
    assert len(set(times)) == len(times)
