"""Ctrl-C asks a search or a study to stop; a second one ends it."""

import os
import signal
import threading

import pytest

from expdesign.stages.outcome import ABANDONED, STOP_DESIGN, Progress, interruptible


def test_ctrl_c_asks_to_stop_and_a_second_one_stops():
    said = []

    def interrupt_twice():
        with interruptible(said.append, STOP_DESIGN, ABANDONED) as stop_requested:
            assert not stop_requested()
            os.kill(os.getpid(), signal.SIGINT)
            assert stop_requested()
            assert said == [STOP_DESIGN]
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        interrupt_twice()
    assert said == [STOP_DESIGN, ABANDONED]
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


def test_progress_that_shows_nothing():
    progress = Progress()
    with progress.search(None) as report, progress.count("repetitions") as advanced:
        report(None)
        advanced(1, 2)
