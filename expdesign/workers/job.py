"""Jobs, the worker process that does one after the other, and the process that starts workers.

A job is a function of picklable data and of an object that its process has built once.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import queue
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import Any, NoReturn

from threadpoolctl import threadpool_limits

from expdesign.configuration import ComputationError


@dataclass(frozen=True)
class Monitor:
    """Receiver of the events of a search or a study, and source of requests to stop.

    Any other object with these functions serves as well.
    """

    stop_requested: Callable[[], bool] = lambda: False
    """Returns whether the work should end with its results so far."""
    report: Callable[[Any], None] = lambda _event: None
    """Receives one event of a job."""
    advanced: Callable[[int, int], None] = lambda _done, _total: None
    """Receives the number of finished repetitions and their total."""


class StoppedError(ComputationError):
    """A stop was requested before there was any result."""


@dataclass(frozen=True)
class Job:
    """A call ``function(built, monitor, *arguments)``; function and arguments are picklable."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    name: str = ""
    """Name under which a journal keeps the result; empty: it is not kept."""
    recalled: Callable[[Any, Monitor, Any], None] | None = None
    """Picklable; reports the result, with what was built, when it comes from a journal."""
    lane: int = 0
    """Results of jobs of one lane have the order of the jobs; lanes do not wait for each other."""
    expected: Any = None
    """Result that is assumed while it is unknown, to do further jobs ahead."""
    key: bytes = b""
    """`content` by which a result that was computed ahead is found; empty: it is not looked up."""

    @cached_property
    def content(self) -> bytes:
        """Hash of the function and the arguments."""
        return hashlib.sha256(pickle.dumps((self.function, self.arguments))).digest()

    def run(self, recipe: bytes, monitor: Monitor) -> Any:
        """Run it with one BLAS thread; the pickled recipe builds its first argument, once."""
        with threadpool_limits(1):
            return self.function(_built_from(recipe), monitor, *self.arguments)


_built: dict[str, Any] = {}


def _built_from(recipe: bytes) -> Any:
    """Build once per process; only the object of the last recipe is kept."""
    key = hashlib.sha256(recipe).hexdigest()
    if key not in _built:
        _built.clear()
        _built[key] = pickle.loads(recipe)()
    return _built[key]


IDLE_SECONDS = 300.0
"""Idle time after which a worker ends: it holds some hundred megabytes."""

JOB, STOP = "job", "stop"
"""Messages of a run: ``(JOB, recipe, pickled job, whether to stop)`` or ``(STOP,)``."""
EVENT, RESULT, ERROR = "event", "result", "error"
"""Messages of a worker: ``(EVENT, event)``, and for every job ``(RESULT, result)`` or
``(ERROR, exception, traceback)``."""


def start_workers(handle: int) -> None:
    """Serve as the process that starts workers: fork one for each connection received.

    It has no threads. It builds the object of a recipe once; workers are forks that have it.
    """
    os.set_inheritable(handle, False)
    run = Connection(handle)
    signal.signal(signal.SIGCHLD, _add_ended_workers)
    while True:
        try:
            if recipe := run.recv_bytes():
                with suppress(Exception):  # a worker reports the error with its job
                    _built_from(recipe)
                continue
            worker = recv_handle(run)
        except (EOFError, OSError):  # the run has ended
            _add_ended_workers()
            os._exit(0)
        process = os.fork()
        if not process:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            run.close()
            serve(worker)
        os.close(worker)
        with suppress(OSError):
            run.send(process)


def _add_ended_workers(*_signal: object) -> None:
    """Add the processor time of workers that have ended to that of this process."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def serve(handle: int) -> NoReturn:
    """Serve as a worker: receive jobs from a connection, send events and results.

    However the run ends, the system closes the connection, and the worker ends at once. Signals
    that end a run are blocked in this process from its beginning: a terminal sends them to the
    workers, too, but only the run handles them.
    """
    run = Connection(handle)
    jobs: queue.Queue[tuple[bytes, bytes]] = queue.Queue()
    stop = threading.Event()
    threading.Thread(target=_listen, args=(run, jobs, stop), daemon=True).start()

    def report(event: Any) -> None:
        run.send((EVENT, event))

    monitor = Monitor(stop.is_set, report)
    while True:
        try:
            run.send_bytes(_answer(*jobs.get(timeout=IDLE_SECONDS), monitor))
        except (queue.Empty, OSError):
            # No job for a long time, or the run has ended. There is nothing to clean up.
            os._exit(0)


def _listen(run: Connection, jobs: queue.Queue[tuple[bytes, bytes]], stop: threading.Event) -> None:
    """Receive the messages of the run; end the process when the run has ended."""
    try:
        while True:
            kind, *content = run.recv()
            if kind == STOP:
                stop.set()
                continue
            recipe, job, stopping = content
            (stop.set if stopping else stop.clear)()
            jobs.put((recipe, job))
    finally:
        os._exit(0)


def _answer(recipe: bytes, packed: bytes, monitor: Monitor) -> bytes:
    try:
        job: Job = pickle.loads(packed)
        return pickle.dumps((RESULT, job.run(recipe, monitor)))
    except Exception as error:  # noqa: BLE001 - raised where the result is waited for
        text = traceback.format_exc()
        try:
            # Some exceptions can be pickled, but not unpickled.
            pickle.loads(answer := pickle.dumps((ERROR, error, text)))
        except Exception:  # noqa: BLE001 - the error is reported whatever it is
            report = RuntimeError(f"{type(error).__name__}: {error}")
            return pickle.dumps((ERROR, report, text))
        return answer
