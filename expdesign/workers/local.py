"""Jobs on local processes, one BLAS thread each, with live events and a way to stop them."""

from __future__ import annotations

import pickle
import queue
import threading
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
        yield from _in_processes(recipe, jobs, used, monitor, after_stop=after_stop)
        return
    for job in jobs:
        if monitor.stop_requested() and not after_stop:
            return
        yield job.run(recipe, monitor)


def _in_processes(
    recipe: bytes, jobs: Sequence[Job], workers: int, monitor: Monitor, *, after_stop: bool
) -> Iterator[Any]:
    team = _Team(recipe, jobs, monitor, after_stop=after_stop)
    # A thread of its own: workers get their next job whatever is done with the results here.
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
        self, recipe: bytes, jobs: Sequence[Job], monitor: Monitor, *, after_stop: bool
    ) -> None:
        self._recipe, self._monitor, self._after_stop = recipe, monitor, after_stop
        self._waiting = iter(enumerate(jobs))
        self._stopping = False
        self._busy: dict[WorkerProcess, int] = {}
        self._free: list[WorkerProcess] = []
        self._answers: queue.Queue[tuple[WorkerProcess, Answer]] = queue.Queue()
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
                yield arrived.pop(following)
                following += 1

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
        """Give jobs to those who have none; tell whether anybody has one."""
        if not self._stopping and self._monitor.stop_requested():
            self._stopping = True
            for worker in self._busy:
                worker.stop()
        while self._free and (self._after_stop or not self._stopping):
            # Taken one by one: a request to stop ends them, however many are left.
            number, job = next(self._waiting, (None, None))
            if number is None or job is None:
                break
            worker = self._free.pop()
            self._busy[worker] = number
            worker.begin(self._recipe, job, stopping=self._stopping)
        return bool(self._busy)

    def _take_answer(self) -> None:
        try:
            worker, answer = self._answers.get(timeout=_POLL)
        except queue.Empty:
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
        self._free.append(worker)
        if kind == ERROR:
            content.add_note(f"In a worker process:\n{''.join(more)}")
            raise content
        self._outcomes.put((number, content))
