"""Jobs on a Dask cluster, and the runner that uses a cluster or local processes.

A cluster may lose workers, its scheduler or the network. Lost workers that come back, and new ones,
get jobs again; a cluster without workers for a minute, or without its scheduler, is lost.
"""

from __future__ import annotations

import logging
import pickle
import queue
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager, suppress
from dataclasses import make_dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ConfigDict
from threadpoolctl import threadpool_limits

from expdesign.configuration import ComputationError, InputError
from expdesign.runfolder.journal import Journal
from expdesign.workers.ahead import Foresee, JobsAhead, foresee_nothing
from expdesign.workers.job import Job, Monitor
from expdesign.workers.local import run_jobs

_CONNECT_SECONDS = 20
_RETURN_SECONDS = 60
"""Time in which lost workers may come back."""
_POLL_SECONDS = 1.0
_WAITING = 2
"""Jobs under way per thread of the cluster: one is being done, one is ready."""


class ClusterError(ComputationError):
    """The cluster cannot be reached, or is lost."""


class JobJournal:
    """Results of the named jobs of a computation that is the same whenever it is done again.

    `inputs` is the hash of everything that the jobs depend on, `kind` the frozen dataclass of the
    results; without `resume` the file begins anew. The `prefix` of the names is the part of the
    computation that is done now.
    """

    def __init__(self, path: Path, inputs: str, kind: type[Any], *, resume: bool) -> None:
        fields = [("name", str), ("result", kind)]
        own = {"__pydantic_config__": ConfigDict(arbitrary_types_allowed=True)}
        self._entry = make_dataclass("JobEntry", fields, namespace=own)
        self._journal: Journal[Any, str] = Journal(
            path, inputs, self._entry, attrgetter("name"), keep=resume
        )
        self.prefix = ""

    @property
    def count(self) -> int:
        """Number of results."""
        return len(self._journal.done)

    def result(self, job: Job) -> Any:
        """Return the result of a job, None if it is unknown."""
        entry = self._journal.done.get(f"{self.prefix}{job.name}")
        return None if entry is None else entry.result

    def recall(self, job: Job) -> Job:
        """Return the job; one that returns the result instead, if it is known."""
        result = self.result(job)
        return job if result is None else replace(job, function=_recall, arguments=(job, result))

    def add(self, name: str, result: Any) -> None:
        """Add the result of a job, if it has a name and is new."""
        full = f"{self.prefix}{name}"
        if name and full not in self._journal.done:
            self._journal.add(self._entry(full, result))


def _recall(built: Any, monitor: Monitor, job: Job, result: Any) -> Any:
    if job.recalled is not None:
        job.recalled(built, monitor, result)
    return result


class JobRunner:
    """Runs jobs in local processes or on a Dask cluster, and adds up their processor time.

    When the cluster is lost the jobs that did not end count as stopped; those that run even after a
    stop are done in this process. `build` makes the first argument of every job, once per process.
    A `scheduler` is the address of a cluster, used instead of so many local `workers`. Events of
    local jobs are all reported, at once; a job on a cluster reports when it ends those that
    `keep_event` selects. Both functions are picklable. The `journal` keeps the results of named
    jobs that no stop has cut short; known ones are not done again.

    `cpu_seconds` is the processor time of all jobs so far whose results were used, each once,
    `lost` the end of the cluster.
    """

    def __init__(
        self,
        build: Callable[[], Any],
        workers: int,
        scheduler: str | None = None,
        keep_event: Callable[[Any], bool] = bool,
        journal: JobJournal | None = None,
    ) -> None:
        self._build, self._workers, self._scheduler = build, workers, scheduler
        self._keep_event, self._journal = keep_event, journal
        self.cpu_seconds = 0.0
        self.lost: ClusterError | None = None
        self._ahead, self._companions = JobsAhead(), 0

    def run(
        self,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] | None = None,
        foresee: Foresee | None = None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in the order of every lane; of fewer after a request to stop.

        With `after_stop` jobs begin even after such a request. `then` gets every result, in the
        order of a lane, and may return a further job. Local workers without another job do the jobs
        ahead that `foresee` returns; their results are used by this and later calls with `foresee`.
        """
        for done in self._done(jobs, monitor, after_stop, then, foresee):
            self.cpu_seconds += done.seconds
            self._keep(done)
            for event in done.events:  # of a job that was done ahead
                monitor.report(event)
            yield done.result

    def _done(
        self,
        jobs: Sequence[Job],
        monitor: Monitor,
        after_stop: bool,
        then: Callable[[Any], Job | None] | None = None,
        foresee: Foresee | None = None,
    ) -> Iterator[_Done]:
        """Yield the results of `run` with their processor time and the events to be reported."""
        begun, required = Counter[int](), set[bytes]()
        scheduler = None if self.lost is not None else self._scheduler
        is_local = scheduler is None
        foresee = foresee if is_local and self._workers > 1 else None

        def timed_job(job: Job) -> Job:
            known = job if self._journal is None else self._journal.recall(job)
            place = job.lane, begun[job.lane]
            begun[job.lane] += 1
            arguments = place, known, None if is_local else self._keep_event
            key = job.content if foresee else b""
            required.add(key)
            return replace(job, function=_run_timed, arguments=arguments, key=key, expected=None)

        def jobs_ahead(is_idle_for_long: bool) -> Iterator[Job]:
            for job in foresee(self.known, is_idle_for_long) if foresee else ():
                if job.content not in required:
                    plain = replace(job, expected=None)
                    arguments = (job.lane, 0), plain, self._keep_event
                    yield replace(plain, function=_run_timed, arguments=arguments, key=job.content)

        def follow(done: _Done) -> Job | None:
            job = then(done.result) if then else None
            return None if job is None else timed_job(job)

        timed = [timed_job(job) for job in jobs]
        if scheduler is not None:
            for done in self._run_on_cluster(scheduler, timed, monitor, follow, after_stop):
                yield done._replace(events=())  # reported
            return
        yield from run_jobs(
            self._build,
            timed,
            self._workers,
            monitor,
            after_stop=after_stop,
            then=follow if then else None,
            ahead=self._ahead if foresee else None,
            foresee=jobs_ahead if foresee else None,
        )

    @property
    def free(self) -> int:
        """Number of workers without a job of `lead`."""
        return self._workers - self._companions

    def lead(
        self,
        built: Any,
        job: Job,
        monitor: Monitor,
        companions: Sequence[Job],
        foresee: Foresee,
    ) -> None:
        """Run a job in this process; `run` with `foresee` then knows its result.

        `built` is its first argument; the job may have other ones run. Workers do the `companions`
        at the same time; their results are then known, too. If the job is not among those that
        `foresee` returns then, it ends early, without a result.
        """
        self._ahead.end_all_but(one.content for one in companions)
        self._companions = len(companions)
        errors = list[BaseException]()

        def run_companions() -> None:
            try:
                list(self._done(companions, monitor, True, foresee=foresee_nothing))
            except BaseException as error:  # noqa: BLE001 - raised in the thread of the caller
                errors.append(error)
            self._companions = 0

        thread = threading.Thread(target=run_companions, daemon=True)
        thread.start()
        needed = list[bool]()

        def is_needed() -> bool:
            if not needed and not self._companions:
                contents = (one.content for one in foresee(self.known, True))
                needed.append(not companions or job.content in contents)
            return all(needed)

        def stop_requested() -> bool:
            return not is_needed() or monitor.stop_requested()

        # Where it may have no result, its events are kept for its use.
        watch = Monitor(stop_requested) if companions else Monitor(stop_requested, monitor.report)
        keep_event = self._keep_event if companions else None
        before, failure = self.cpu_seconds, None
        try:
            with threadpool_limits(1):
                done = _run_timed(built, watch, (0, 0), job, keep_event)
        except Exception as error:  # noqa: BLE001 - raised if the job is needed
            failure = error
        finally:
            thread.join()
        if errors:
            raise errors[0]
        if not is_needed():
            self.cpu_seconds = before
        elif failure is not None:
            raise failure
        else:
            self._ahead.known[job.content] = done

    def has_begun(self, job: Job) -> bool:
        """Return whether a job has begun ahead, or its result is known."""
        return job.content in self._ahead.begun or self.known(job) is not None

    def known(self, job: Job) -> Any:
        """Return the result of a job that was done ahead or may be asked for again, or None."""
        done = self._ahead.known.get(job.content)
        if done is None:
            return None if self._journal is None else self._journal.result(job)
        return done.result

    def close(self) -> None:
        """End the jobs ahead that are under way."""
        self._ahead.end_all_but(())

    def _keep(self, done: _Done) -> None:
        if self._journal is not None and not done.stopped:
            self._journal.add(done.name, done.result)

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
        found: dict[tuple[int, int], _Done] = {}
        waiting, following = deque(jobs), Counter[int]()
        ended = set[tuple[int, int]]()

        def is_stopped() -> bool:
            return monitor.stop_requested() and not after_stop

        try:
            # Closing cancels the cluster's jobs, whatever happens here.
            with closing(cluster_jobs(scheduler, self._build, waiting, is_stopped)) as results:
                for done in results:
                    found[done.place] = done
                    ended.add(done.place)
                    self._keep(done)
                    for event in done.events:  # monitors on the cluster are silent
                        monitor.report(event)
                    lane, _ = done.place
                    while (lane, following[lane]) in found:
                        job = then(found[lane, following[lane]])
                        if job is not None:
                            waiting.append(job)
                        yield found.pop((lane, following[lane]))
                        following[lane] += 1
        except ClusterError as error:
            self.lost = error
            if after_stop:
                left = [job for job in jobs if job.arguments[0] not in ended]
                stopping = Monitor(lambda: True, monitor.report)
                here = run_jobs(self._build, left, self._workers, stopping, after_stop=True)
                found |= {done.place: done for done in here}
        for _, done in sorted(found.items()):  # after a stop: jobs before them were cancelled
            then(done)
            yield done


class _Done(NamedTuple):
    """Result of a job, its processor time, s, and the events that were kept."""

    place: tuple[int, int]
    """Lane, and place in it."""
    name: str
    result: Any
    stopped: bool
    """Whether a stop may have cut it short."""
    seconds: float
    events: tuple[Any, ...]


def _run_timed(
    built: Any,
    monitor: Monitor,
    place: tuple[int, int],
    job: Job,
    keep_event: Callable[[Any], bool] | None,
) -> _Done:
    """Run a job; events are kept for its end where `keep_event` is given."""
    began, kept = time.process_time(), list[Any]()

    def report(event: Any) -> None:
        if keep_event is not None and keep_event(event):
            kept.append(event)
        monitor.report(event)

    result = job.function(built, Monitor(monitor.stop_requested, report), *job.arguments)
    stopped, seconds = monitor.stop_requested(), time.process_time() - began
    return _Done(place, job.name, result, stopped, seconds, tuple(kept))


def cluster_jobs(
    address: str,
    build: Callable[[], Any],
    jobs: deque[Job],
    stop_requested: Callable[[], bool],
) -> Generator[Any, None, None]:
    """Run jobs on the cluster of a scheduler; yield their results in the order of their ends.

    The address is ``tcp://host:port``. Workers import this package: they need the same versions. A
    worker does one job at a time, whatever its number of threads. Jobs are taken from the beginning
    of `jobs`; those appended later are done as well. Their monitor is silent, and their exceptions
    are raised here. `build`, picklable, makes the first argument of every job, once per process.
    Every second `stop_requested` is called; True cancels the jobs under way.
    """
    client_class, killed = _library()
    with _quiet():
        try:
            client = client_class(address, timeout=_CONNECT_SECONDS, set_as_default=False)
        except OSError as error:
            raise ClusterError(f"the scheduler {address} cannot be reached: {error}") from error
        try:
            yield from _results(client, address, build, jobs, stop_requested, killed)
        finally:
            with suppress(*_LOST, RuntimeError):
                client.close(timeout=_POLL_SECONDS)


_LOST = (OSError, TimeoutError, CancelledError, ValueError)
"""Errors of a connection that has ended; closed communications raise a ValueError."""


def _results(
    client: Any,
    address: str,
    build: Callable[[], Any],
    jobs: deque[Job],
    stop_requested: Callable[[], bool],
    killed: type[BaseException],
) -> Generator[Any, None, None]:
    _wait_for_workers(client, address)
    # A job of its own: the scheduler makes it again when the workers that had it are lost.
    packed = _submit(client, address, _unchanged, pickle.dumps(build))
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    under_way = set[Any]()
    last_seen = time.monotonic()
    try:
        while jobs or under_way:
            threads = _threads(client, address)
            if threads:
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > _RETURN_SECONDS:
                raise ClusterError(f"the cluster of {address} has lost all its workers")
            while jobs and len(under_way) < max(1, _WAITING * threads):
                future = _submit(client, address, _run_on_worker, packed, jobs.popleft())
                under_way.add(future)
                future.add_done_callback(ended.put)
            with suppress(queue.Empty):
                future = ended.get(timeout=_POLL_SECONDS)
                try:
                    result = future.result(timeout=_POLL_SECONDS)
                except TimeoutError:
                    if future.status == "error":
                        raise  # that of the job
                    ended.put(future)  # its worker has died since, and it is done again
                except killed as error:
                    raise ClusterError(
                        f"workers of the cluster of {address} died, perhaps out of memory"
                    ) from error
                except CancelledError as error:
                    raise ClusterError(f"the cluster of {address} was lost") from error
                else:
                    under_way.discard(future)
                    yield result
            if stop_requested():
                return
    finally:
        with suppress(*_LOST, RuntimeError):
            if client.status == "running":
                client.cancel([*under_way, packed])


def _wait_for_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_CONNECT_SECONDS)
    except TimeoutError as error:
        raise ClusterError(f"the cluster of {address} has no workers") from error
    except _LOST as error:
        raise ClusterError(f"the cluster of {address} was lost: {error}") from error


def _submit(client: Any, address: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Submit a job that is not pure: another study's job with the same arguments is another task.

    A client whose connection has just ended raises an exception of a special class.
    """
    try:
        return client.submit(function, *arguments, pure=False)
    except Exception as error:
        if client.status == "running":
            raise
        raise ClusterError(f"the cluster of {address} was lost: {error}") from error


def _threads(client: Any, address: str) -> int:
    try:
        if client.status != "running":
            raise ClusterError(f"the connection to the scheduler {address} was lost")
        return int(sum(client.nthreads().values()))
    except _LOST as error:
        raise ClusterError(f"the scheduler {address} was lost: {error}") from error


def _unchanged(content: bytes) -> bytes:
    return content


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the library's own messages about lost connections: the error names the cluster."""
    # Tasks of a lost connection are reported when they are collected, which may be much later.
    logging.getLogger("asyncio").addFilter(_is_of_others)
    names = [n for n in logging.root.manager.loggerDict if n.split(".")[0] in {"distributed"}]
    loggers = [logging.getLogger(name) for name in (*names, "tornado", "asyncio")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _is_of_others(record: logging.LogRecord) -> bool:
    """Return whether a message is not about an exception that the library defines."""
    kind = record.exc_info[0] if record.exc_info else None
    return kind is None or not kind.__module__.startswith("distributed.")


def _library() -> tuple[Any, type[BaseException]]:
    try:
        from distributed import Client, KilledWorker  # noqa: PLC0415 - optional
    except ImportError as error:
        raise InputError(
            "a Dask cluster is reached with distributed, which is not installed",
            key="scheduler",
            allowed="workers: …, or after: pip install expdesign[dask]",
        ) from error
    return Client, KilledWorker


_one_at_a_time = threading.Lock()


def _run_on_worker(recipe: bytes, job: Job) -> Any:
    with _one_at_a_time:
        return job.run(recipe, Monitor())
