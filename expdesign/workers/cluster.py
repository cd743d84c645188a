"""Jobs on a Dask cluster."""

from __future__ import annotations

import pickle
import threading
from collections import deque
from collections.abc import Callable, Generator
from typing import Any

from expdesign.configuration import ComputationError, InputError
from expdesign.workers.job import Job, Monitor

_CONNECT_SECONDS = 20
_WAITING = 2
"""Jobs under way for every thread of the cluster: one is worked on, one is ready."""


class ClusterError(ComputationError):
    """The cluster cannot be reached, or lost a worker for good."""


def cluster_jobs(
    address: str,
    build: Callable[[], Any],
    jobs: deque[Job],
    stop_requested: Callable[[], bool],
) -> Generator[Any, None, None]:
    """Do jobs on the cluster of a scheduler; yield their results in the order in which they end.

    Workers import this package: they need the same versions. A worker does one job at a time,
    whatever number of threads it has. The jobs' monitor is silent.

    Parameters
    ----------
    address : str
        ``tcp://host:port``.
    build : callable
        Picklable; builds what every job gets as its first argument, once per process.
    jobs : deque
        Taken from its beginning; what is appended meanwhile is done as well.
    stop_requested : callable
        Asked after every job; those under way are then given up.

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
            return [client.submit(_in_cluster, packed, job, pure=False) for job in few]

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
                "workers of the cluster died, perhaps for want of memory; what is done is kept"
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


def _in_cluster(recipe: bytes, job: Job) -> Any:
    with _one_at_a_time:
        return job.run(recipe, Monitor())
