"""The progress of a search: what the numbers are."""

import dataclasses
import io

import pytest
from rich.console import Console

from expdesign.cli.terminal import SearchDisplay
from expdesign.information.criteria import CRITERIA
from expdesign.solver.stage import SearchEvent

CONDITION = dataclasses.replace(CRITERIA["condition"], flat=True)


@pytest.fixture
def display():
    return SearchDisplay(Console(file=io.StringIO(), width=200, soft_wrap=True), CONDITION, 3)


def said(display):
    return display._console.file.getvalue()


def event(phase, objective, status="", violation=1e-3):
    return SearchEvent(1, phase, 7, objective, violation, 2.0, status)


def test_the_first_line_comes_before_the_first_event(display):
    with display.shown():
        assert said(display).startswith("building the problem")
        display.report(event("blunt", 90.0))
        assert "built after 0 s" in said(display)


def test_every_number_says_what_it_is(display, monkeypatch):
    monkeypatch.setattr("expdesign.cli.terminal._HEARTBEAT", -1.0)
    display.report(event("blunt", 90.5))
    display.report(event("sharp", 1234.0))
    display.report(event("done", 1300.0, "converged"))
    display.report(event("finished", 1250.0, "every limit kept", violation=-1e-5))
    display.report(event("done", float("inf"), "given up: behind"))
    _, blunt, sharp, done, finished, given_up = said(display).splitlines()
    assert "start 1: blunt, iteration 7, log det F 90.5 (smoothed)" in blunt
    assert "condition number of F 1234 (smoothed)" in sharp
    assert "condition number of F 1300 (true) within the limits after 7 iterations" in done
    assert finished == "start 1, finished: condition number of F 1250 (true), every limit kept"
    assert given_up == "start 1/3: given up: behind (7 iterations, 2 s)"
    assert display._ended == 2
    assert display._best.objective == 1250


def test_the_best_is_the_smallest_of_a_criterion_that_is_minimised(display):
    for value in (1300.0, 1200.0, float("inf"), 1250.0):
        display.report(event("done", value))
    assert display._best.objective == 1200


def test_what_breaks_a_limit_is_never_the_best(display):
    display.report(event("done", 1300.0))
    display.report(event("finished", 1200.0, "a limit is broken", violation=2e-6))
    assert display._best.objective == 1300
    display.report(event("finished", 1250.0, "every limit kept", violation=0.0))
    assert display._best.objective == 1250
