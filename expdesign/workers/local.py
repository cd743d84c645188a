"""Jobs in local processes, with live events and requests to stop; isolated Python programs."""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from multiprocessing.connection import Connection, Pipe
from multiprocessing.reduction import send_handle
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from expdesign.configuration import ComputationError
from expdesign.interruption import ENDING
from expdesign.progress import listen_to_progress
from expdesign.workers.ahead import JobsAhead
from expdesign.workers.job import ERROR, EVENT, IDLE_SECONDS, JOB, STOP, Job, Monitor

T = TypeVar("T")
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
    ahead: JobsAhead | None = None,
    foresee: Callable[[bool], Iterable[Job]] | None = None,
) -> Iterator[Any]:
    """Run jobs in up to `workers` processes; yield their results in the jobs' order, lane by lane.

    Processes have one BLAS thread each. They stay for the next jobs, with the objects that they
    have built, and they end with this process; with one worker everything runs in this process.
    `build`, picklable, makes the first argument of every job, once per process. The monitor
    receives the events of all jobs; its request to stop reaches them between two iterations. Jobs
    begin even then with `after_stop`, such as those that save results; otherwise fewer results are
    yielded. An exception of a job is raised here, and a process that ended without a result is a
    `WorkerDiedError`.

    `then` gets every result, in the order of the jobs of a lane, before it is yielded, in the
    thread of the caller. A job that it returns is added at the end, unless a stop was requested.

    Workers of jobs `ahead` go on when these jobs are done. `foresee` returns the jobs to be done
    ahead by workers that have no other job, with their keys. It gets whether they will have none
    for long, and is called in the thread of the caller after results, at least ten times a second.
    """
    recipe = pickle.dumps(build)
    used = min(workers, len(jobs))
    # An idle process may have built the object already.
    if used > 1 or (used == 1 < workers and (foresee or has_idle_worker())):
        team = _Team(
            recipe,
            jobs,
            monitor,
            after_stop=after_stop,
            then=then,
            ahead=ahead or JobsAhead(),
            foresee=foresee,
            most=workers if foresee else used,
        )
        # In another thread, workers get further jobs while the caller handles the results.
        direction = threading.Thread(target=team.direct, args=(used,), daemon=True)
        direction.start()
        try:
            yield from team.outcomes()
        finally:
            team.abandoned.set()
            direction.join()
        return
    waiting = deque(jobs)
    while waiting and (after_stop or not monitor.stop_requested()):
        result = waiting.popleft().run(recipe, monitor)
        following = then(result) if then else None
        if following is not None:
            waiting.append(following)
        yield result


class _Team:
    """Workers for a list of jobs; a thread distributes the jobs and receives the answers."""

    def __init__(
        self,
        recipe: bytes,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool,
        then: Callable[[Any], Job | None] | None,
        ahead: JobsAhead,
        foresee: Callable[[bool], Iterable[Job]] | None,
        most: int,
    ) -> None:
        self._recipe, self._monitor, self._after_stop = recipe, monitor, after_stop
        self._ahead, self._foresee, self._most = ahead, foresee, most
        self._waiting, self._begun = deque(jobs), Counter[int]()
        self._then, self._open = then, len(jobs) if then else 0
        """Number of jobs that may still be followed by another one."""
        self._stopping = False
        self._busy: dict[WorkerProcess, tuple[int, int, bytes]] = {}
        """Lane, place in it and key of the job of each busy worker."""
        self._claimed = set[WorkerProcess]()
        """Workers whose job began ahead: its result has its events."""
        self._free: list[WorkerProcess] = []
        self._answers = ahead.answers
        """None: there may be another job."""
        self._outcomes: queue.Queue[tuple[tuple[int, int] | None, Any] | BaseException | None]
        self._outcomes = queue.Queue()
        """Lane and place of a result; None: of a job ahead."""
        self.abandoned = threading.Event()
        """Set when the caller has closed the iterator: busy workers are then ended."""

    def outcomes(self) -> Iterator[Any]:
        """Yield the results in the jobs' order of every lane; raise the exception of a job."""
        arrived: dict[tuple[int, int], Any] = {}
        following = Counter[int]()
        while True:
            if self._foresee is not None and self._outcomes.empty():
                is_idle_for_long = max(self._open, len(self._busy)) < self._most
                foreseen = self._foresee(is_idle_for_long) if self._room > 0 else ()
                self._ahead.wanted = list(islice(foreseen, self._most))
                self._answers.put(None)
            try:
                outcome = self._outcomes.get(timeout=_POLL)
            except queue.Empty:  # signals are handled between two waits
                continue
            if outcome is None:
                return
            if isinstance(outcome, BaseException):
                raise outcome
            place, result = outcome
            if place is not None:
                arrived[place] = result
                lane, _ = place
                while (lane, following[lane]) in arrived:
                    result = arrived.pop((lane, following[lane]))
                    following[lane] += 1
                    self._follow(result)
                    yield result

    @property
    def _room(self) -> int:
        """Number of workers that required jobs do not need at present."""
        return self._most - len(self._busy) - len(self._waiting)

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
        """Distribute all jobs."""
        try:
            count = min(workers, max(self._most - len(self._ahead.busy), 0))
            self._free = take_workers(count, self._answers, self._recipe)
            while self._hand_out() and not self.abandoned.is_set():
                self._take_answer()
            self._outcomes.put(None)
        except BaseException as error:  # noqa: BLE001 - raised in the thread of the caller
            self._outcomes.put(error)
        finally:
            for worker in self._busy:
                worker.end()
            return_workers(self._free)

    def _hand_out(self) -> bool:
        """Give jobs to idle workers; return whether any job is under way or may follow."""
        if not self._stopping and self._monitor.stop_requested():
            self._stopping = True
            self._ahead.end_all_but(())
            for worker in self._busy:
                worker.stop()
        # One by one: a request to stop prevents all further ones.
        while self._waiting and (self._after_stop or not self._stopping):
            if not self._begin(self._waiting[0]):
                break
            self._waiting.popleft()
        while not self._stopping and (job := self._ahead.next()):
            is_full = len(self._ahead.busy) >= self._room
            if is_full and not (self._room > 0 and self._ahead.end_one(unwanted=True)):
                break
            worker = self._idle_worker()
            self._ahead.busy[worker] = job.key
            self._ahead.begun.add(job.key)
            worker.begin(self._recipe, job, stopping=False)
        return bool(self._busy) or (self._open > 0 and (self._after_stop or not self._stopping))

    def _begin(self, job: Job) -> bool:
        """Begin a required job, or take its result; return whether there was a worker."""
        lane, place = job.lane, self._begun[job.lane]
        if job.key in self._ahead.known:
            self._outcomes.put(((lane, place), self._ahead.known[job.key]))
        elif worker := self._ahead.claim(job.key):
            self._busy[worker] = lane, place, job.key
            self._claimed.add(worker)
        else:
            is_full = len(self._busy) + len(self._ahead.busy) >= self._most
            if is_full and not self._ahead.end_one():
                return False
            worker = self._idle_worker()
            self._busy[worker] = lane, place, job.key
            worker.begin(self._recipe, job, stopping=self._stopping)
        self._begun[lane] += 1
        return True

    def _idle_worker(self) -> WorkerProcess:
        worker = self._free.pop() if self._free else None
        if worker is None or not worker.is_fit:  # idle for too long
            if worker is not None:
                worker.end()
            (worker,) = take_workers(1, self._answers, self._recipe)
        return worker

    def _take_answer(self) -> None:
        try:
            answered = self._answers.get(timeout=_POLL)
        except queue.Empty:
            return
        if answered is None:
            return
        worker, answer = answered
        if answer is None and worker not in self._busy:
            self._ahead.busy.pop(worker, None)
            return
        if answer is None:
            raise WorkerDiedError(
                "a worker process died, perhaps out of memory; fewer workers need less memory"
            )
        is_ahead = worker in self._ahead.busy
        if not is_ahead and worker not in self._busy:  # ended meanwhile
            return
        kind, content, *more = pickle.loads(answer)
        if kind == EVENT:
            if not is_ahead and worker not in self._claimed:
                self._monitor.report(content)
            return
        self._claimed.discard(worker)
        lane, number, key = (
            (0, 0, self._ahead.busy.pop(worker)) if is_ahead else self._busy.pop(worker)
        )
        worker.idle_since = time.monotonic()
        self._free.append(worker)
        if kind == ERROR and is_ahead:  # raised when the job is required
            return
        if kind == ERROR:
            content.add_note(f"In a worker process:\n{''.join(more)}")
            raise content
        if key and not self._stopping:
            self._ahead.known[key] = content
        self._outcomes.put((None if is_ahead else (lane, number), content))


Answer = bytes | None
"""A pickled message of `expdesign.workers.job`; None when the process has ended."""

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
_ERRORS = 2
"""Standard error of this process, which also receives the standard output of workers."""
_KEPT = 0.8 * IDLE_SECONDS
"""Idle time after which a worker gets no further job: it is about to end."""


class WorkerProcess:
    """A process that does one job at a time, with a connection to it.

    The end of this process closes the connection, and that ends the worker. The recipe, a pickled
    function, builds the object of the first jobs before the worker starts.
    """

    def __init__(self, recipe: bytes) -> None:
        self._connection, its = Pipe()
        with its:
            self._process = _start_worker(recipe, its.fileno())
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self.answers: queue.Queue[tuple[WorkerProcess, Answer] | None] = queue.Queue()
        """Receives the answers; set before a job is given."""
        self.idle_since = time.monotonic()
        self._has_ended = False
        self._listener.start()

    def _listen(self) -> None:
        # The connection breaks if the process was killed before it received everything.
        with contextlib.suppress(EOFError, OSError):
            while True:
                answer = self._connection.recv_bytes()
                # After the answer has arrived: the queue may be replaced between answers.
                self.answers.put((self, answer))
        self._has_ended = True
        self.answers.put((self, None))

    def begin(self, recipe: bytes, job: Job, *, stopping: bool) -> None:
        """Give it a job, and pass on whether a stop was requested."""
        self._send((JOB, recipe, pickle.dumps(job), stopping))

    def stop(self) -> None:
        """Pass a request to stop to its job."""
        self._send((STOP,))

    def _send(self, message: tuple[Any, ...]) -> None:
        # The end of the process is noticed by its answer.
        with contextlib.suppress(OSError):
            self._connection.send(message)

    @property
    def is_fit(self) -> bool:
        """Whether it is alive and will still be when it gets a job."""
        idle = time.monotonic() - self.idle_since
        return not self._has_ended and idle < _KEPT

    def end(self) -> None:
        """End it at once."""
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._process, signal.SIGKILL)
        self._listener.join()
        self._connection.close()
        os.close(self._process)


_PATIENCE = 5.0
"""Time in which the process that starts workers ends once it has no connection, s."""


class _Starter:
    """The process that starts workers, in an environment that this process has had."""

    def __init__(self) -> None:
        self._made_for, self._recipe, self._has_forked = _surroundings(), b"", False
        self._connection, its = Pipe()
        handle = its.fileno()
        program = (
            f"import gc; gc.set_threshold{gc.get_threshold()}; "
            f"from expdesign.workers.job import start_workers; start_workers({handle})"
        )
        with its, _blocked_signals():
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", program],
                stdin=subprocess.DEVNULL,
                stdout=_ERRORS,
                env=_environment(),
                pass_fds=[handle],
            )

    @property
    def is_fit(self) -> bool:
        """Whether it is alive and has this process's environment."""
        return self._process.poll() is None and self._made_for == _surroundings()

    def build(self, recipe: bytes) -> None:
        """Have it build the object of a recipe, which workers that are started later have."""
        if recipe != self._recipe:
            self._recipe = recipe
            self._connection.send_bytes(recipe)

    def start(self, recipe: bytes, handle: int) -> int:
        """Start a worker with a connection; return a file descriptor of its process."""
        self.build(recipe)
        self._has_forked = True
        self._connection.send_bytes(b"")
        send_handle(self._connection, handle, self._process.pid)
        return os.pidfd_open(self._connection.recv())

    def end(self) -> None:
        """End it; its workers stay."""
        self._connection.close()
        if not self._has_forked:  # it may be importing modules still
            self._process.kill()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


_starters: list[_Starter] = []
"""That of this process, once there is one."""
_starting = threading.Lock()


def prepare_workers(build: Callable[[], Any] | None = None) -> None:
    """Start the process that starts workers, and have it build what their jobs need.

    This returns at once: the process takes a second to import its modules.
    """
    with _starting:
        starter = _fit_starter()
        if build is not None:
            with contextlib.suppress(OSError):  # the first worker that is started reports it
                starter.build(pickle.dumps(build))


def _fit_starter() -> _Starter:
    if _starters and not _starters[0].is_fit:
        _starters.pop().end()
    if not _starters:
        _starters.append(_Starter())
    return _starters[0]


def _start_worker(recipe: bytes, handle: int) -> int:
    """Start a worker; return a file descriptor of its process."""
    with _starting:
        starter = _fit_starter()
        try:
            return starter.start(recipe, handle)
        except (EOFError, OSError) as error:
            starter.end()
            message = "no worker process could be started, perhaps for lack of memory"
            raise WorkerDiedError(message) from error


def _surroundings() -> tuple[str, dict[str, str]]:
    """Return the folder and the environment that a process gets from this one."""
    return str(Path.cwd()), _environment()


_idle: list[WorkerProcess] = []
_foreign: list[object] = []
_lock = threading.Lock()


def take_workers(
    count: int, answers: queue.Queue[tuple[WorkerProcess, Answer] | None], recipe: bytes
) -> list[WorkerProcess]:
    """Return workers, idle ones first; their answers go to `answers`."""
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
            team.append(WorkerProcess(recipe))
    except BaseException:
        return_workers(team)
        raise
    for worker in team:
        worker.answers = answers
    return team


def has_idle_worker() -> bool:
    """Return whether there is an idle worker."""
    with _lock:
        return any(worker.is_fit for worker in _idle)


def return_workers(workers: Iterable[WorkerProcess]) -> None:
    """Keep idle workers for later jobs."""
    with _lock:
        _idle.extend(workers)


@atexit.register
def _end_all() -> None:
    while _idle:
        _idle.pop().end()
    while _starters:
        _starters.pop().end()


def _forget() -> None:
    """Leave the workers to the parent in a copy of this process."""
    for own in (_idle, _starters):
        _foreign.extend(own)
        own.clear()


os.register_at_fork(after_in_child=_forget)


@contextlib.contextmanager
def _blocked_signals() -> Iterator[None]:
    """Block the signals that end a run while a process starts.

    A terminal sends them to every process. A worker inherits the mask and keeps it. In this process
    they arrive afterwards.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _environment() -> dict[str, str]:
    """Return the environment of a Python process with this one's path and one BLAS thread."""
    folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
    return {**os.environ, "PYTHONPATH": folders, **dict.fromkeys(_THREADS, "1")}


def run_in_copies(work: Callable[[int], T], count: int) -> list[T]:
    """Return ``work(0)`` … ``work(count − 1)``, the first from here, each other from a copy.

    A copy of this process has all objects and modules at once; it must not use what other threads
    use here. It is quiet, and what a copy fails to return is done here.
    """
    copies: list[tuple[int, Connection]] = []
    for number in range(1, count):
        source, sink = Pipe(duplex=False)
        with sink, warnings.catch_warnings(), _blocked_signals():
            warnings.simplefilter("ignore", DeprecationWarning)  # threads: see above
            try:
                child = os.fork()
            except OSError:  # no room for another process
                source.close()
                break
            if not child:
                _answer_from_copy(work, number, sink)
        copies.append((child, source))
    results: dict[int, T] = {}
    try:
        results[0] = work(0)
    finally:
        for number, (child, source) in enumerate(copies, start=1):
            with source, contextlib.suppress(EOFError, OSError):
                results[number] = pickle.loads(source.recv_bytes())
            os.waitpid(child, 0)
    return [results[k] if k in results else work(k) for k in range(count)]


def _answer_from_copy(work: Callable[[int], Any], number: int, sink: Connection) -> NoReturn:
    status = 1
    try:
        with listen_to_progress(lambda *_: None):
            sink.send_bytes(pickle.dumps(work(number)))
        status = 0
    finally:
        os._exit(status)


_SECONDS = 300
_MEMORY = 4_000_000_000

_LIMITS = f"""
import resource, sys, warnings
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_AS, ({_MEMORY}, {_MEMORY}))
warnings.simplefilter("ignore")
"""


class EndlessError(Exception):
    """A program did not end in time."""


def run_isolated(program: str, path: Path) -> bytes | None:
    """Return the output of a Python program on a file, ``sys.argv[1]``; None if it fails.

    It runs in a separate process with 4 GB of memory, for libraries that trust the sizes in a file:
    one wrong byte may crash them or exhaust the memory. After 300 s it is an `EndlessError`.
    """
    try:
        child = subprocess.run(
            [sys.executable, "-P", "-c", _LIMITS + program, str(path)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env=_environment(),
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EndlessError from None
    return child.stdout if child.returncode == 0 else None
