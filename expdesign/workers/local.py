"""Jobs on local processes, one BLAS thread each, with live events and a way to stop them."""

from __future__ import annotations

import itertools
import pickle
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from expdesign.configuration import ComputationError
from expdesign.workers.job import Job, Monitor
from expdesign.workers.process import Answer, WorkerProcess, any_idle, given_back, taken
from expdesign.workers.served import ERROR, EVENT

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
