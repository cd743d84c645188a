"""Ctrl-C and other signals ask a search or a study to stop; a second Ctrl-C ends it."""

import os
import signal
import sys
import threading
import time

import pytest

from expdesign.interruption import ENDING, interruptible, raise_interruptions, without_interruptions
from expdesign.runfolder.lock import one_writer

OTHERS = [number for number in ENDING if number != signal.SIGINT]


def handlers():
    return [signal.getsignal(number) for number in ENDING]


def test_ctrl_c_asks_to_stop_and_a_second_one_stops():
    said = []

    def interrupt_twice():
        with interruptible(said.append, "KEPT", "GIVES UP", "ABANDONED") as stop_requested:
            assert not stop_requested()
            os.kill(os.getpid(), signal.SIGINT)
            assert stop_requested()
            (text,) = said
            assert all(part in text for part in ("KEPT", "Ctrl-C again", "GIVES UP"))
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        interrupt_twice()
    assert said[1:] == ["ABANDONED"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_thread_of_its_own_takes_no_signals():
    found = []

    def work():
        with interruptible(found.append, "stopping") as stop_requested:
            found.append(stop_requested())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [False]


@pytest.mark.parametrize("number", OTHERS)
def test_signals_that_end_a_process_ask_to_stop_however_often_they_come(number):
    said, before = [], handlers()
    with interruptible(said.append, "KEPT", "GIVES UP", "ABANDONED") as stop_requested:
        for _ in range(3):
            signal.raise_signal(number)
        assert stop_requested()
        (text,) = said
        assert all(part in text for part in ("KEPT", number.name, "Ctrl-C GIVES UP"))
        assert "again" not in text, "nobody pressed it"
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert said[1:] == ["ABANDONED"]
    assert handlers() == before


@pytest.mark.parametrize("number", OTHERS)
def test_a_signal_that_is_ignored_or_handled_otherwise_is_left_alone(number):
    seen = []

    def handle(*_arguments):
        seen.append(number)

    for handler, times in ((signal.SIG_IGN, 0), (handle, 1)):
        before = signal.signal(number, handler)
        try:
            with (
                raise_interruptions(seen.clear),
                interruptible(seen.append, "stopping") as stop_requested,
            ):
                signal.raise_signal(number)
                assert not stop_requested()
        finally:
            signal.signal(number, before)
        assert len(seen) == times


@pytest.mark.parametrize("error", [OSError("the terminal is gone"), RuntimeError("reentrant call")])
def test_what_cannot_be_said_is_no_reason_not_to_stop(error):
    def note(_text):
        raise error

    with interruptible(note, "stopping") as stop_requested:
        signal.raise_signal(signal.SIGINT)
        assert stop_requested()


@pytest.mark.parametrize("number", ENDING)
def test_every_signal_is_an_interruption(number):
    before = handlers()
    with raise_interruptions(lambda: None), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    with raise_interruptions(lambda: None), without_interruptions():
        signal.raise_signal(number)
    assert handlers() == before


def test_amid_an_import_the_process_is_ended(tmp_path, monkeypatch):
    (tmp_path / "that_takes_long.py").write_text(
        "import signal\nsignal.raise_signal(signal.SIGINT)\n", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(tmp_path)

    class EndedError(BaseException):
        pass

    folder, seen = tmp_path / "new" / "run", []

    def end():
        seen.append(folder.parent.exists())
        raise EndedError

    with raise_interruptions(end), pytest.raises(EndedError), one_writer(folder, "expdesign run"):
        __import__("that_takes_long")
    assert seen == [False], "neither a lock nor an empty folder is left"


def test_an_interruption_that_cannot_be_raised_is_raised_afterwards():
    class Interrupted:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    def ended():
        thing = Interrupted()
        del thing
        time.sleep(60)

    before = sys.unraisablehook
    with raise_interruptions(lambda: None), pytest.raises(KeyboardInterrupt):
        ended()
    assert sys.unraisablehook is before
