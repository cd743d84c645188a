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
from io import FileIO
from pathlib import Path
from typing import Any, cast

from expdesign.interruption import ENDING
from expdesign.workers.channel import receive, send
from expdesign.workers.job import Job
from expdesign.workers.served import IDLE_SECONDS, JOB, STOP

Answer = tuple[Any, ...] | None
"""As `expdesign.workers.served` sends it; None when the process has ended."""

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
_KEPT = 0.8 * IDLE_SECONDS
"""A worker that was idle for longer is about to end by itself, and gets no job."""


class WorkerProcess:
    """A process that does one job at a time.

    It is a program of its own, with a pipe to it and one from it. No other process is needed, no
    file and no name in the system: whatever ends this process closes the pipes, which ends it.
    """

    def __init__(self) -> None:
        folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
        with _signals_held():
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-P", "-c"),
                    "from expdesign.workers.served import serve; serve()",
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env={**os.environ, "PYTHONPATH": folders, **dict.fromkeys(_THREADS, "1")},
                # Where there are such groups, Ctrl-C of the terminal is not for it.
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )
        self._requests = cast(FileIO, self._process.stdin)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self.answers: queue.Queue[tuple[WorkerProcess, Answer]] = queue.Queue()
        """Takes what it answers; whoever gives it a job sets it before."""
        self.idle_since = time.monotonic()
        self._listener.start()

    def _listen(self) -> None:
        answer: Answer = ()
        with cast(FileIO, self._process.stdout) as pipe:
            while answer is not None:
                try:
                    answer = receive(pipe)
                except EOFError:
                    answer = None
                except Exception as error:  # noqa: BLE001 - told to whoever waits
                    error.add_note("A worker's answer cannot be read.")
                    answer = ("error", error, "")
                self.answers.put((self, answer))

    def begin(self, recipe: bytes, job: Job, *, stopping: bool) -> None:
        """Give it a job, and tell whether a stop has been requested."""
        self._tell((JOB, recipe, pickle.dumps(job), stopping))

    def stop(self) -> None:
        """Pass a request to stop on to its job."""
        self._tell((STOP,))

    def _tell(self, message: tuple[Any, ...]) -> None:
        # One that has ended is noticed by its answer.
        with contextlib.suppress(OSError):
            send(self._requests, message)

    @property
    def is_fit(self) -> bool:
        """Whether it lives, and will still when it gets a job."""
        return self._process.poll() is None and time.monotonic() - self.idle_since < _KEPT

    def end(self) -> None:
        """End it at once, whatever it does."""
        self._process.kill()
        self._process.wait()
        self._listener.join()
        with contextlib.suppress(OSError):
            self._requests.close()


_idle: list[WorkerProcess] = []
_foreign: list[WorkerProcess] = []
_lock = threading.Lock()


def taken(count: int, answers: queue.Queue[tuple[WorkerProcess, Answer]]) -> list[WorkerProcess]:
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


def given_back(workers: Iterable[WorkerProcess]) -> None:
    """Keep workers without a job for the next that has some."""
    for worker in workers:
        worker.idle_since = time.monotonic()
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

    A terminal sends them to every process. A worker inherits that they are held, until it ignores
    them. In this process they arrive afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
