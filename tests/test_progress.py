"""What a computation tells, and who hears it."""

import threading

from expdesign.progress import (
    forward_progress,
    listen_to_progress,
    progress_prefix,
    report_progress,
    track,
)


def test_nobody_has_to_listen():
    report_progress("anything", 1, 2)
    assert list(track("items", [3, 4])) == [3, 4]


def test_a_listener_hears_how_far_it_is():
    heard = []
    with listen_to_progress(lambda *one: heard.append(one)):
        seen = [(item, len(heard)) for item in track("items", ["a", "b"])]
        report_progress("end")
    report_progress("too late")
    assert seen == [("a", 1), ("b", 2)]
    assert heard == [("items", 0, 2), ("items", 1, 2), ("end", 0, 0)]


def test_parts_are_named_until_they_end():
    heard = []
    with listen_to_progress(lambda what, *_: heard.append(what)):
        with progress_prefix("table"):
            with progress_prefix("file"):
                report_progress("rows")
            report_progress("check")
        report_progress("end")
    assert [what.split(": ") for what in heard] == [
        ["table", "file", "rows"],
        ["table", "check"],
        ["end"],
    ]


def test_the_listener_before_hears_again_and_other_threads_are_not_heard():
    outer, inner = [], []
    with listen_to_progress(lambda what, *_: outer.append(what)):
        with listen_to_progress(lambda what, *_: inner.append(what)):
            report_progress("one")
        thread = threading.Thread(target=report_progress, args=("elsewhere",))
        thread.start()
        thread.join()
        report_progress("two")
    assert (outer, inner) == (["two"], ["one"])


def test_what_another_thread_is_at_is_heard_where_it_is_passed_on():
    heard = []

    def work(report):
        with listen_to_progress(lambda *told: report(told)), progress_prefix("file"):
            report_progress("rows", 1, 2)

    with listen_to_progress(lambda *one: heard.append(one)), progress_prefix("table"):
        thread = threading.Thread(target=work, args=(forward_progress(),))
        thread.start()
        thread.join()
        work(forward_progress())
    assert heard == [("table: file: rows", 1, 2)] * 2
