"""Repetitions on a Dask cluster."""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from estimation.montecarlo.repetition import Recipe, Repetition, Workbench
from expdesign.configuration import InputError, Problem

_CONNECT_SECONDS = 20
_WAITING = 2
"""Repetitions under way for every thread of the cluster: one is worked on, one is ready."""


class ClusterError(RuntimeError):
    """The cluster cannot be reached, or lost a worker for good."""


def cluster_repetitions(
    address: str, recipe: Recipe, numbers: Sequence[int], stop_requested: Callable[[], bool]
) -> Iterator[Repetition]:
    """Do repetitions on the cluster of a scheduler; yield them in the order in which they end.

    Workers import this package: they need the same versions. A worker does one repetition at a
    time, whatever number of threads it has.

    Parameters
    ----------
    address : str
        ``tcp://host:port``.
    recipe : Recipe
    numbers : sequence of int
    stop_requested : callable
        Asked after every repetition; those under way are then given up.

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
        remaining = iter(numbers)
        packed = client.scatter(pickle.dumps(recipe), broadcast=True, hash=False)

        def submit(count: int) -> list[Any]:
            few = [number for _, number in zip(range(count), remaining, strict=False)]
            # Not pure: another study's repetition with the same number is another task.
            return [client.submit(_repetition, packed, number, pure=False) for number in few]

        first = submit(_WAITING * sum(client.nthreads().values()))
        pool = as_completed(first, loop=client.loop)
        try:
            for future in pool:
                yield future.result()
                if stop_requested():
                    return
                pool.update(submit(1))
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
            Problem(
                "a Dask cluster is reached with distributed, which is not installed",
                key="scheduler",
                allowed="workers: …, or after: pip install expdesign[dask]",
            )
        ) from error
    return Client, as_completed, KilledWorker


_bench: dict[str, Workbench] = {}
_one_at_a_time = threading.Lock()


def _repetition(packed: bytes, number: int) -> Repetition:
    """Do one repetition in a worker, which keeps the workbench of the last study."""
    key = hashlib.sha256(packed).hexdigest()
    with _one_at_a_time, threadpool_limits(1):
        if key not in _bench:
            _bench.clear()
            _bench[key] = pickle.loads(packed)()
        return _bench[key].repeat(number)
