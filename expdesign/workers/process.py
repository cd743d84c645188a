"""Worker processes as their run sees them: started when needed, kept for the next jobs."""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any

from expdesign.interruption import ENDING
from expdesign.workers.job import Job
from expdesign.workers.served import IDLE_SECONDS, JOB, STOP

Answer = bytes | None
"""As `expdesign.workers.served` sends it, pickled; None when the process has ended."""

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
_ERRORS = 2
"""Where standard output of a worker goes, too: what a library prints there."""
_KEPT = 0.8 * IDLE_SECONDS
"""A worker that was idle for longer is about to end by itself, and gets no job."""


class WorkerProcess:
    """A process that does one job at a time.

    It is a program of its own, with a connection to it. No other process is needed, no file and no
    name in the system: whatever ends this process closes the connection, which ends it.
    """

    def __init__(self) -> None:
        folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
        self._connection, its = Pipe()
        handle = its.fileno()
        with its, _signals_held():
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-P", "-c"),
                    f"from expdesign.workers.served import serve; serve({handle})",
                ],
                stdin=subprocess.DEVNULL,
                stdout=_ERRORS,
                env={**os.environ, "PYTHONPATH": folders, **dict.fromkeys(_THREADS, "1")},
                pass_fds=[handle],
            )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self.answers: queue.Queue[tuple[WorkerProcess, Answer] | None] = queue.Queue()
        """Takes what it answers; whoever gives it a job sets it before."""
        self.idle_since = time.monotonic()
        self._listener.start()

    def _listen(self) -> None:
        # One that was killed before it took all that was sent is an error.
        with contextlib.suppress(EOFError, OSError):
            while True:
                answer = self._connection.recv_bytes()
                # Not before it is there: where answers go changes while there are none.
                self.answers.put((self, answer))
        self.answers.put((self, None))

    def begin(self, recipe: bytes, job: Job, *, stopping: bool) -> None:
        """Give it a job, and tell whether a stop has been requested."""
        self._tell((JOB, recipe, pickle.dumps(job), stopping))

    def stop(self) -> None:
        """Pass a request to stop on to its job."""
        self._tell((STOP,))

    def _tell(self, message: tuple[Any, ...]) -> None:
        # One that has ended is noticed by its answer.
        with contextlib.suppress(OSError):
            self._connection.send(message)

    @property
    def is_fit(self) -> bool:
        """Whether it lives, and will still when it gets a job."""
        return self._process.poll() is None and time.monotonic() - self.idle_since < _KEPT

    def end(self) -> None:
        """End it at once, whatever it does."""
        self._process.kill()
        self._process.wait()
        self._listener.join()
        self._connection.close()


_idle: list[WorkerProcess] = []
_foreign: list[WorkerProcess] = []
_lock = threading.Lock()


def taken(
    count: int, answers: queue.Queue[tuple[WorkerProcess, Answer] | None]
) -> list[WorkerProcess]:
    """Return workers, those first that are there already; what they answer goes to `answers`."""
    with _lock:
        idle, _idle[:] = _idle[::-1], []
    fit = [worker for worker in idle if worker.is_fit]
    for worker in idle:
        if worker not in fit:
            worker.end()
    team = fit[:count]
    with _lock:
        _idle.extend(fit[count:])
    try:
        while len(team) < count:
            team.append(WorkerProcess())
    except BaseException:
        given_back(team)
        raise
    for worker in team:
        worker.answers = answers
    return team


def any_idle() -> bool:
    """Tell whether there is a worker without a job."""
    with _lock:
        return any(worker.is_fit for worker in _idle)


def given_back(workers: Iterable[WorkerProcess]) -> None:
    """Keep workers without a job for the next that has some."""
    with _lock:
        _idle.extend(workers)


@atexit.register
def _end_all() -> None:
    while _idle:
        _idle.pop().end()


def _forget() -> None:
    """Leave workers alone in a copy of this process: they are not its own."""
    _foreign.extend(_idle)
    _idle.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Hold the signals that end a run while a worker starts.

    A terminal sends them to every process. A worker inherits that they are held, for all its life.
    In this process they arrive afterwards.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
