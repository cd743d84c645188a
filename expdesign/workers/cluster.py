"""Jobs on a Dask cluster, and the runner that uses a cluster or local processes."""

from __future__ import annotations

import itertools
import pickle
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from typing import Any, NamedTuple

from expdesign.configuration import ComputationError, InputError
from expdesign.workers.job import Job, Monitor
from expdesign.workers.local import run_jobs

_CONNECT_SECONDS = 20
_WAITING = 2
"""Jobs under way per thread of the cluster: one is being done, one is ready."""


class ClusterError(ComputationError):
    """The cluster cannot be reached, or lost a worker for good."""


class JobRunner:
    """Runs jobs in local processes or on a Dask cluster, and adds up their processor time.

    Parameters
    ----------
    build : callable
        Picklable; builds the first argument of every job, once per process.
    workers : int
        Number of local processes.
    scheduler : str, optional
        Address of a Dask cluster, used instead of local processes.
    keep_event : callable, optional
        Picklable; selects the events that a job on a cluster reports when it ends. Events of local
        jobs are all reported, at once.

    Attributes
    ----------
    cpu_seconds : float
        Processor time of all jobs so far.
    """

    def __init__(
        self,
        build: Callable[[], Any],
        workers: int,
        scheduler: str | None = None,
        keep_event: Callable[[Any], bool] = bool,
    ) -> None:
        self._build, self._workers, self._scheduler = build, workers, scheduler
        self._keep_event = keep_event
        self.cpu_seconds = 0.0

    def run(
        self,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] = lambda _result: None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in their order; of fewer after a request to stop.

        Parameters
        ----------
        after_stop : bool
            Whether jobs begin even after a request to stop.
        then : callable, optional
            Gets every result, in their order, and may return a further job.
        """
        numbers = itertools.count()

        def timed_job(job: Job) -> Job:
            return Job(_run_timed, (next(numbers), job, self._keep_event))

        def follow(done: _Done) -> Job | None:
            self.cpu_seconds += done.seconds
            job = then(done.result)
            return None if job is None else timed_job(job)

        timed = [timed_job(job) for job in jobs]
        if self._scheduler is None:
            work = run_jobs(
                self._build, timed, self._workers, monitor, after_stop=after_stop, then=follow
            )
        else:
            work = self._run_on_cluster(self._scheduler, timed, monitor, follow, after_stop)
        for done in work:
            yield done.result

    def _run_on_cluster(
        self,
        scheduler: str,
        jobs: Sequence[Job],
        monitor: Monitor,
        then: Callable[[_Done], Job | None],
        after_stop: bool,
    ) -> Iterator[_Done]:
        if monitor.stop_requested() and not after_stop:
            return
        found: dict[int, _Done] = {}
        waiting, following = deque(jobs), 0

        def is_stopped() -> bool:
            return monitor.stop_requested() and not after_stop

        # Closing cancels the cluster's jobs, whatever happens here.
        with closing(cluster_jobs(scheduler, self._build, waiting, is_stopped)) as results:
            for done in results:
                found[done.number] = done
                for event in done.events:  # monitors on the cluster are silent
                    monitor.report(event)
                while following in found:
                    job = then(found[following])
                    if job is not None:
                        waiting.append(job)
                    yield found.pop(following)
                    following += 1
        for _, done in sorted(found.items()):  # after a stop: jobs before them were cancelled
            then(done)
            yield done


class _Done(NamedTuple):
    """Result of a job, its processor time, s, and the events that were kept."""

    number: int
    result: Any
    seconds: float
    events: tuple[Any, ...]


def _run_timed(
    built: Any, monitor: Monitor, number: int, job: Job, keep_event: Callable[[Any], bool]
) -> _Done:
    began, kept = time.process_time(), list[Any]()

    def report(event: Any) -> None:
        if keep_event(event):
            kept.append(event)
        monitor.report(event)

    result = job.function(built, Monitor(monitor.stop_requested, report), *job.arguments)
    return _Done(number, result, time.process_time() - began, tuple(kept))


def cluster_jobs(
    address: str,
    build: Callable[[], Any],
    jobs: deque[Job],
    stop_requested: Callable[[], bool],
) -> Generator[Any, None, None]:
    """Run jobs on the cluster of a scheduler; yield their results in the order of their ends.

    Workers import this package: they need the same versions. A worker does one job at a time,
    whatever its number of threads. The jobs' monitor is silent.

    Parameters
    ----------
    address : str
        ``tcp://host:port``.
    build : callable
        Picklable; builds the first argument of every job, once per process.
    jobs : deque
        Taken from its beginning; jobs appended later are done as well.
    stop_requested : callable
        Called after every job; True cancels the jobs under way.

    Raises
    ------
    InputError
        Dask is not installed.
    ClusterError
        The scheduler cannot be reached, or workers died.
    """
    client_class, as_completed, killed = _library()
    try:
        client = client_class(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except OSError as error:
        raise ClusterError(f"the scheduler {address} cannot be reached: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_SECONDS)
        except TimeoutError as error:
            raise ClusterError(f"the cluster of {address} has no workers") from error
        packed = client.scatter(pickle.dumps(build), broadcast=True, hash=False)

        def submit(count: int) -> list[Any]:
            # Not pure: another study's job with the same arguments is another task.
            few = [jobs.popleft() for _ in range(min(count, len(jobs)))]
            return [client.submit(_run_on_worker, packed, job, pure=False) for job in few]

        most = _WAITING * sum(client.nthreads().values())
        first = submit(most)
        pool, under_way = as_completed(first, loop=client.loop), len(first)
        try:
            for future in pool:
                yield future.result()
                if stop_requested():
                    return
                more = submit(most - under_way + 1)
                under_way += len(more) - 1
                pool.update(more)
        except killed as error:
            raise ClusterError(
                "workers of the cluster died, perhaps out of memory; finished work is kept"
            ) from error
        finally:
            client.cancel(list(pool.futures))


def _library() -> tuple[Any, Any, type[BaseException]]:
    try:
        from distributed import Client, KilledWorker, as_completed  # noqa: PLC0415 - optional
    except ImportError as error:
        raise InputError(
            "a Dask cluster is reached with distributed, which is not installed",
            key="scheduler",
            allowed="workers: …, or after: pip install expdesign[dask]",
        ) from error
    return Client, as_completed, KilledWorker


_one_at_a_time = threading.Lock()


def _run_on_worker(recipe: bytes, job: Job) -> Any:
    with _one_at_a_time:
        return job.run(recipe, Monitor())
