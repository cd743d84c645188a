"""Jobs on local processes, one BLAS thread each, with live events and a way to stop them."""

from __future__ import annotations

import atexit
import contextlib
import itertools
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any

from expdesign.configuration import ComputationError
from expdesign.interruption import ENDING
from expdesign.workers.job import ERROR, EVENT, IDLE_SECONDS, JOB, STOP, Job, Monitor

_POLL = 0.1


class WorkerDiedError(ComputationError):
    """A worker process ended without a result."""


def run_jobs(
    build: Callable[[], Any],
    jobs: Sequence[Job],
    workers: int,
    monitor: Monitor,
    *,
    after_stop: bool = False,
    then: Callable[[Any], Job | None] | None = None,
) -> Iterator[Any]:
    """Run jobs in up to `workers` processes; yield their results in the jobs' order.

    Processes stay for the next jobs, with what they have built. They end with this process,
    whatever ends it.

    Parameters
    ----------
    build : callable
        Picklable; builds what every job gets as its first argument, once per process.
    workers : int
        1: everything runs in this process.
    monitor : Monitor
        Gets the events of all jobs; its request to stop reaches them between two iterations.
    after_stop : bool
        Whether jobs begin although a stop has been requested: those that save the results.
        Otherwise they are left out, and fewer results come.
    then : callable, optional
        Gets every result, in the jobs' order, before it is yielded, where the results are taken; a
        job that it returns is done after those that are there, unless a stop was requested.

    Raises
    ------
    WorkerDiedError
        A process ended without a result.
    Exception
        What a job has raised.
    """
    recipe = pickle.dumps(build)
    used = min(workers, len(jobs))
    # One that is there already may have built what the job needs.
    if used > 1 or (used == 1 < workers and any_idle()):
        team = _Team(recipe, jobs, monitor, after_stop=after_stop, then=then)
        yield from _in_processes(team, used)
        return
    waiting = deque(jobs)
    while waiting and (after_stop or not monitor.stop_requested()):
        result = waiting.popleft().run(recipe, monitor)
        following = then(result) if then else None
        if following is not None:
            waiting.append(following)
        yield result


def _in_processes(team: _Team, workers: int) -> Iterator[Any]:
    # A thread of its own: workers get the jobs that are there whatever is done with results here.
    direction = threading.Thread(target=team.direct, args=(workers,), daemon=True)
    direction.start()
    try:
        yield from team.outcomes()
    finally:
        team.abandoned.set()
        direction.join()


class _Team:
    """Workers that do jobs together, in a thread that hands these out and takes the answers."""

    def __init__(
        self,
        recipe: bytes,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool,
        then: Callable[[Any], Job | None] | None,
    ) -> None:
        self._recipe, self._monitor, self._after_stop = recipe, monitor, after_stop
        self._waiting, self._numbers = deque(jobs), itertools.count()
        self._then, self._open = then, len(jobs) if then else 0
        """How many jobs there are that others may follow from."""
        self._stopping = False
        self._busy: dict[WorkerProcess, int] = {}
        self._free: list[WorkerProcess] = []
        self._answers: queue.Queue[tuple[WorkerProcess, Answer] | None] = queue.Queue()
        """None: there may be another job."""
        self._outcomes: queue.Queue[tuple[int, Any] | BaseException | None] = queue.Queue()
        self.abandoned = threading.Event()
        """Set when nobody waits for outcomes any more: workers that have a job are ended."""

    def outcomes(self) -> Iterator[Any]:
        """Yield the results in the jobs' order; raise what a job has raised."""
        arrived: dict[int, Any] = {}
        following = 0
        while True:
            try:
                # Not without end: on some systems no signal gets through meanwhile.
                outcome = self._outcomes.get(timeout=_POLL)
            except queue.Empty:
                continue
            if outcome is None:
                return
            if isinstance(outcome, BaseException):
                raise outcome
            number, result = outcome
            arrived[number] = result
            while following in arrived:
                result = arrived.pop(following)
                following += 1
                self._follow(result)
                yield result

    def _follow(self, result: Any) -> None:
        if self._then is None:
            return
        job = self._then(result)
        if job is None:
            self._open -= 1
        else:
            self._waiting.append(job)
        self._answers.put(None)

    def direct(self, workers: int) -> None:
        """Have all jobs done."""
        try:
            self._free = taken(workers, self._answers)
            while self._hand_out() and not self.abandoned.is_set():
                self._take_answer()
            self._outcomes.put(None)
        except BaseException as error:  # noqa: BLE001 - it is raised where the results are taken
            self._outcomes.put(error)
        finally:
            for worker in self._busy:
                worker.end()
            given_back(self._free)

    def _hand_out(self) -> bool:
        """Give jobs to those who have none; tell whether anybody has one, or one may follow."""
        if not self._stopping and self._monitor.stop_requested():
            self._stopping = True
            for worker in self._busy:
                worker.stop()
        while self._free and (self._after_stop or not self._stopping):
            # Taken one by one: a request to stop ends them, however many are left.
            if not self._waiting:
                break
            worker, job = self._free.pop(), self._waiting.popleft()
            if not worker.is_fit:  # it had nothing to do for long
                worker.end()
                (worker,) = taken(1, self._answers)
            self._busy[worker] = next(self._numbers)
            worker.begin(self._recipe, job, stopping=self._stopping)
        return bool(self._busy) or (self._open > 0 and (self._after_stop or not self._stopping))

    def _take_answer(self) -> None:
        try:
            answered = self._answers.get(timeout=_POLL)
        except queue.Empty:
            return
        if answered is None:
            return
        worker, answer = answered
        if answer is None and worker not in self._busy:
            return
        if answer is None:
            raise WorkerDiedError(
                "a worker process died, perhaps for want of memory; fewer workers need less"
            )
        kind, content, *more = pickle.loads(answer)
        if kind == EVENT:
            self._monitor.report(content)
            return
        number = self._busy.pop(worker)
        worker.idle_since = time.monotonic()
        self._free.append(worker)
        if kind == ERROR:
            content.add_note(f"In a worker process:\n{''.join(more)}")
            raise content
        self._outcomes.put((number, content))


Answer = bytes | None
"""As `expdesign.workers.job` sends it, pickled; None when the process has ended."""

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
                    f"from expdesign.workers.job import serve; serve({handle})",
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


_SECONDS = 300
_MEMORY = 4_000_000_000

_LIMITS = f"""
import resource, sys, warnings
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_AS, ({_MEMORY}, {_MEMORY}))
warnings.simplefilter("ignore")
"""


class EndlessError(Exception):
    """The program did not end."""


def output_of(program: str, path: Path) -> bytes | None:
    """Return what a Python program prints of a file, ``sys.argv[1]``; None where it fails.

    It has 4 GB of memory.

    Raises
    ------
    EndlessError
        It does not end within 300 s.
    """
    folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
    try:
        child = subprocess.run(
            [sys.executable, "-P", "-c", _LIMITS + program, str(path)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env={**os.environ, "PYTHONPATH": folders, "OPENBLAS_NUM_THREADS": "1"},
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EndlessError from None
    return child.stdout if child.returncode == 0 else None
