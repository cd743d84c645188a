"""A job: a function of picklable data, done with what its process has built once."""

from __future__ import annotations

import hashlib
import os
import pickle
import queue
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from threadpoolctl import threadpool_limits

from expdesign.configuration import ComputationError


@dataclass(frozen=True)
class Monitor:
    """What a search or a study reports to, and asks whether to stop; by default nobody.

    Anything with the functions that are called does as well.
    """

    stop_requested: Callable[[], bool] = lambda: False
    """Whether the work should end with what it has."""
    report: Callable[[Any], None] = lambda _event: None
    """Takes one event, of whatever kind the jobs report."""
    advanced: Callable[[int, int], None] = lambda _done, _total: None
    """Takes how many repetitions are done, of all that are wanted."""


class StoppedError(ComputationError):
    """A stop was requested before there was anything that could be kept."""


@dataclass(frozen=True)
class Job:
    """A call ``function(built, monitor, *arguments)``; function and arguments are picklable."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def run(self, recipe: bytes, monitor: Monitor) -> Any:
        """Do it with one BLAS thread, and with what the pickled recipe builds in this process."""
        with threadpool_limits(1):
            return self.function(_built_from(recipe), monitor, *self.arguments)


_built: dict[str, Any] = {}


def _built_from(recipe: bytes) -> Any:
    """Build once per process; what the last recipe built stays."""
    key = hashlib.sha256(recipe).hexdigest()
    if key not in _built:
        _built.clear()
        _built[key] = pickle.loads(recipe)()
    return _built[key]


IDLE_SECONDS = 300.0
"""A worker that has nothing to do for so long ends: it holds some hundred megabytes."""

JOB, STOP = "job", "stop"
"""What a run sends: ``(JOB, recipe, pickled job, whether to stop)`` or ``(STOP,)``."""
EVENT, RESULT, ERROR = "event", "result", "error"
"""What it gets: ``(EVENT, event)``, and for every job ``(RESULT, result)`` or
``(ERROR, exception, traceback)``."""


def serve(handle: int) -> None:
    """Be a worker: take jobs from a connection, send events and results there.

    The connection is also what the worker lives by. However the run ends, the system closes it, and
    the worker ends at once. Signals that end a run are the run's own business: a terminal sends
    them to its workers, too. They are held when this process begins, and stay so.
    """
    os.set_inheritable(handle, False)
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
            # Nothing to do, or nobody to do it for. Nothing here has to be put in order.
            os._exit(0)


def _listen(run: Connection, jobs: queue.Queue[tuple[bytes, bytes]], stop: threading.Event) -> None:
    """Take what the run sends; end the process when the run has ended."""
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
    """Do a job; return its result, or what went wrong in a form that arrives, pickled."""
    try:
        job: Job = pickle.loads(packed)
        return pickle.dumps((RESULT, job.run(recipe, monitor)))
    except Exception as error:  # noqa: BLE001 - raised where the result is waited for
        text = traceback.format_exc()
        try:
            # Some exceptions can be pickled and not be made again.
            pickle.loads(answer := pickle.dumps((ERROR, error, text)))
        except Exception:  # noqa: BLE001 - whatever it is, there is something to tell
            said = RuntimeError(f"{type(error).__name__}: {error}")
            return pickle.dumps((ERROR, said, text))
        return answer
