"""What a computation tells, and who hears it."""

import threading

from expdesign.progress import part, passed_on, tell, told, told_to


def test_nobody_has_to_listen():
    tell("anything", 1, 2)
    assert list(told("items", [3, 4])) == [3, 4]


def test_a_listener_hears_how_far_it_is():
    heard = []
    with told_to(lambda *one: heard.append(one)):
        seen = [(item, len(heard)) for item in told("items", ["a", "b"])]
        tell("end")
    tell("too late")
    assert seen == [("a", 1), ("b", 2)]
    assert heard == [("items", 0, 2), ("items", 1, 2), ("end", 0, 0)]


def test_parts_are_named_until_they_end():
    heard = []
    with told_to(lambda what, *_: heard.append(what)):
        with part("table"):
            with part("file"):
                tell("rows")
            tell("check")
        tell("end")
    assert [what.split(": ") for what in heard] == [
        ["table", "file", "rows"],
        ["table", "check"],
        ["end"],
    ]


def test_the_listener_before_hears_again_and_other_threads_are_not_heard():
    outer, inner = [], []
    with told_to(lambda what, *_: outer.append(what)):
        with told_to(lambda what, *_: inner.append(what)):
            tell("one")
        thread = threading.Thread(target=tell, args=("elsewhere",))
        thread.start()
        thread.join()
        tell("two")
    assert (outer, inner) == (["two"], ["one"])


def test_what_another_thread_is_at_is_heard_where_it_is_passed_on():
    heard = []

    def work(report):
        with told_to(lambda *told: report(told)), part("file"):
            tell("rows", 1, 2)

    with told_to(lambda *one: heard.append(one)), part("table"):
        thread = threading.Thread(target=work, args=(passed_on(),))
        thread.start()
        thread.join()
        work(passed_on())
    assert heard == [("table: file: rows", 1, 2)] * 2
