"""Progress that shows nothing, and the words of its reports."""

from types import SimpleNamespace

from expdesign.experiment import setup
from expdesign.progress import listen_to_progress, report_progress
from expdesign.stages.stage import Progress


def test_progress_that_shows_nothing():
    progress = Progress()
    with progress.search(None) as report, progress.count("repetitions") as advanced:
        report(None)
        advanced(1, 2)


def test_items_are_named_before_the_first_of_them_is_done():
    heard = []
    with listen_to_progress(lambda *report: heard.append(report)):
        report_progress("loading modules")
        with Progress().count("designs"):
            assert heard[-1] == ("designs", 0, 0)


def test_what_only_loads_code_does_not_report_a_proof(monkeypatch):
    plan = SimpleNamespace(problem=SimpleNamespace(kernels=()))
    monkeypatch.setattr(setup, "plan_search", lambda *_: plan)
    monkeypatch.setattr(setup, "is_usable", lambda: True)
    monkeypatch.setattr(setup, "_run_proof", lambda *_: report_progress("proving the limits"))
    monkeypatch.setattr(setup, "_run_solver", lambda *_: None)
    heard = []
    with listen_to_progress(lambda *report: heard.append(report[0])):
        assert setup.ready_plan(None) is plan
    assert heard == ["loading the compiled model"]
