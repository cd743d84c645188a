"""What a stage is at, on a terminal and elsewhere."""

import io
import time
from itertools import pairwise

import pytest
from rich.console import Console

from expdesign.cli.activity import GROWTH, HEARTBEAT, LONGEST, Activity, left_text
from results.notation import duration


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        now = 100.0

        def monotonic(self):
            return self.now

    one = Clock()
    monkeypatch.setattr("expdesign.cli.activity.time", one)
    return one


def lines(console):
    return console.file.getvalue().splitlines()


def test_elsewhere_a_line_at_growing_intervals(clock):
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "export")
    spoken = []
    for done in range(4000):
        clock.now += 1.0
        activity.show_progress("rows", done, 4000)
        if len(lines(console)) > len(spoken):
            spoken.append(clock.now - 100.0)
    for sooner, later in pairwise(spoken):
        pause = max(HEARTBEAT, min(GROWTH * sooner, LONGEST))
        assert later - sooner == pytest.approx(pause, abs=1.5)
    assert spoken[0] == 3.0
    assert all("export" in line and "rows" in line and "of 4000" in line for line in lines(console))


def test_a_line_is_repeated_after_a_minute_at_the_earliest(clock):
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "estimate")
    for _ in range(90):
        clock.now += 1.0
        activity.show_progress("drawing figures", 0, 1)
    assert len(lines(console)) == 2


def test_what_lasts_is_named_although_nothing_reports(clock, monkeypatch):
    monkeypatch.setattr("expdesign.cli.activity._CHECKED", 0.01)
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "design")
    with activity.display():
        clock.now += 10.0
        activity.show_progress("the reach of each coordinate", 0, 6)
        clock.now += 1.0
        activity.show_progress("compiling", 0, 0)
        assert len(lines(console)) == 1
        clock.now += 20.0
        deadline = time.monotonic() + 60
        while len(lines(console)) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
    assert "compiling" in lines(console)[-1]


def test_what_is_quick_says_nothing(clock):
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "report")
    with activity.display():
        activity.show_progress("sections", 0, 3)
        clock.now += 1.0
        activity.show_progress("sections", 2, 3)
    assert lines(console) == []


def test_the_time_left_is_that_of_this_run(clock):
    """Of repetitions that an earlier run has done nobody knows how long they took."""
    activity = Activity(Console(file=io.StringIO()), "montecarlo")
    activity.show_progress("repetitions", 90, 100)
    clock.now += 20.0
    activity.show_progress("repetitions", 95, 100)
    assert "20 s left" in activity.line


def test_the_time_left_never_grows_while_a_step_lasts(clock):
    activity = Activity(Console(file=io.StringIO()), "estimate")
    activity.show_progress("struts", 0, 6)
    clock.now += 10.0
    activity.show_progress("struts", 5, 6)
    assert "about 2 s left" in activity.line
    clock.now += 1.0
    activity.show_progress("struts", 5, 6)
    assert "about 1 s left" in activity.line
    clock.now += 60.0
    assert "left" not in activity.line
    assert "5 of 6" in activity.line


def test_nothing_is_said_while_another_display_has_the_terminal(clock):
    console = Console(file=io.StringIO(), width=200)
    activity = Activity(console, "design")
    with activity.show_instead(lambda: "a table"):
        activity.paused = True
        clock.now += 100.0
        activity.show_progress("figures", 0, 3)
    assert lines(console) == []
    activity.show_progress("figures", 1, 3)
    assert len(lines(console)) == 1


def test_a_bar_is_gone_when_the_stage_is_done(clock):
    console = Console(file=io.StringIO(), width=80, force_terminal=True, legacy_windows=False)
    activity = Activity(console, "estimate")
    clock.now += 10.0
    with activity.display():
        activity.show_progress("struts", 2, 6)
        console._live_stack[0].refresh()
        with activity.show_instead(lambda: "another display"):
            console._live_stack[0].refresh()
        clock.now += 10.0
        activity.show_progress("struts", 4, 6)
    written = console.file.getvalue()
    assert "another display" in written
    assert "2 of 6" in written
    assert "4 of 6" in written
    assert written.endswith("\x1b[1A\x1b[2K") or "\x1b[2K" in written[-20:]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (125, "2 min 5 s"), (4800, "1 h 20 min")]
)
def test_times(seconds, text):
    assert duration(round(seconds)) == text


@pytest.mark.parametrize(("passed", "share"), [(10.0, 0.0), (10.0, 1.0), (0.1, 0.5)])
def test_what_is_not_known_is_not_guessed(passed, share):
    assert left_text(passed, share) == ""


def test_the_rest_takes_as_long_in_proportion():
    assert "30 s" in left_text(10.0, 0.25)
