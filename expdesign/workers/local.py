"""Jobs on local processes, one BLAS thread each, with live events and a way to stop them."""

from __future__ import annotations

import pickle
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import takewhile
from multiprocessing import Manager
from typing import Any

from joblib import Parallel, delayed, parallel_config

from expdesign.configuration import ComputationError
from expdesign.workers.job import Job, Monitor

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
    """
    recipe = pickle.dumps(build)
    if min(workers, len(jobs)) > 1:
        yield from _in_processes(
            recipe, jobs, min(workers, len(jobs)), monitor, after_stop=after_stop
        )
        return
    for job in jobs:
        if monitor.stop_requested() and not after_stop:
            return
        yield job.run(recipe, monitor)


def _in_processes(
    recipe: bytes, jobs: Sequence[Job], workers: int, monitor: Monitor, *, after_stop: bool
) -> Iterator[Any]:
    with Manager() as manager:
        events, stop, done = manager.Queue(), manager.Event(), threading.Event()
        pump = threading.Thread(target=_pump, args=(events, stop, done, monitor), daemon=True)
        pump.start()
        try:
            with parallel_config("loky", n_jobs=workers, inner_max_num_threads=1):
                run = Parallel(return_as="generator", pre_dispatch=workers)
                # Taken one by one: a request to stop ends them, however many are left.
                wanted = takewhile(lambda _: after_stop or not monitor.stop_requested(), jobs)
                calls = (
                    delayed(_in_worker)(recipe, job, events, stop, after_stop) for job in wanted
                )
                # Ctrl-C goes to every process of the terminal. Workers inherit that it is ignored,
                # so that not even one that is still starting dies of it.
                with _interrupts_ignored():
                    outcomes = run(calls)
                for began, result in outcomes:
                    if began:
                        yield result
        except BrokenProcessPool as error:
            raise WorkerDiedError(
                "a worker process died, perhaps for want of memory; fewer workers need less"
            ) from error
        finally:
            done.set()
            pump.join()


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    # Only the main thread may set handlers; elsewhere the workers ignore Ctrl-C once they run.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _pump(events: Any, stop: Any, done: threading.Event, monitor: Monitor) -> None:
    """Carry events from the workers to the monitor, and its request to stop back."""
    while True:
        if monitor.stop_requested() and not stop.is_set():
            stop.set()
        try:
            monitor.report(events.get(timeout=_POLL))
        except queue.Empty:
            if done.is_set():
                return


def _in_worker(
    recipe: bytes, job: Job, events: Any, stop: Any, after_stop: bool
) -> tuple[bool, Any]:
    """Return whether the job was begun, and its result."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if stop.is_set() and not after_stop:
        return False, None
    return True, job.run(recipe, Monitor(stop.is_set, events.put))
