"""What a worker process does: jobs, one after the other, for as long as its run lives."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import threading
import traceback
from io import FileIO
from typing import Any

from expdesign.interruption import ENDING
from expdesign.workers.channel import receive, send
from expdesign.workers.job import Job, Monitor

IDLE_SECONDS = 300.0
"""A worker that has nothing to do for so long ends: it holds some hundred megabytes."""

JOB, STOP = "job", "stop"
"""What a run sends: ``(JOB, recipe, pickled job, whether to stop)`` or ``(STOP,)``."""
EVENT, RESULT, ERROR = "event", "result", "error"
"""What it gets: ``(EVENT, event)``, and for every job ``(RESULT, result)`` or
``(ERROR, exception, traceback)``."""


def serve() -> None:
    """Be a worker: take jobs from standard input, send events and results to standard output.

    The pipe from the run is also what the worker lives by. However the run ends, the system closes
    it, and the worker ends at once. Signals that end a run are the run's own business: a terminal
    sends them to its workers, too.
    """
    _ignore_signals()
    requests, answers = FileIO(os.dup(0), "rb"), FileIO(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)  # what a library prints is no message
    jobs: queue.Queue[tuple[bytes, bytes]] = queue.Queue()
    stop = threading.Event()
    threading.Thread(target=_listen, args=(requests, jobs, stop), daemon=True).start()

    def report(event: Any) -> None:
        send(answers, (EVENT, event))

    monitor = Monitor(stop.is_set, report)
    while True:
        try:
            recipe, packed = jobs.get(timeout=IDLE_SECONDS)
            send(answers, _answer(recipe, packed, monitor))
        except (queue.Empty, OSError):
            # Nothing to do, or nobody to do it for. Nothing here has to be put in order.
            os._exit(0)


def _listen(
    requests: FileIO, jobs: queue.Queue[tuple[bytes, bytes]], stop: threading.Event
) -> None:
    """Take what the run sends; end the process when the run has ended."""
    try:
        while True:
            kind, *content = receive(requests)
            if kind == STOP:
                stop.set()
                continue
            recipe, job, stopping = content
            (stop.set if stopping else stop.clear)()
            jobs.put((recipe, job))
    finally:
        os._exit(0)


def _answer(recipe: bytes, packed: bytes, monitor: Monitor) -> tuple[Any, ...]:
    """Do a job; return its result, or what went wrong in a form that arrives."""
    try:
        job: Job = pickle.loads(packed)
        answer = (RESULT, job.run(recipe, monitor))
        pickle.dumps(answer)
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            raise  # an event that nobody takes
        return _failure(error)
    except Exception as error:  # noqa: BLE001 - raised where the result is waited for
        return _failure(error)
    return answer


def _failure(error: Exception) -> tuple[Any, ...]:
    text = traceback.format_exc()
    try:
        # Some exceptions can be pickled and not be made again.
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001 - whatever it is, there is something to tell
        return ERROR, RuntimeError(f"{type(error).__name__}: {error}"), text
    return ERROR, error, text


def _ignore_signals() -> None:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        # They were held while this process was started: none can have ended it until now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
