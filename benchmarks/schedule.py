"""Searches of PaLiDA on 1 to 64 workers: their schedule with measured times of the jobs.

The search runs once in this process, where the processor time of every job is taken. Its decisions
and the same results then follow the clock of a simulated machine with any number of cores; the
proof runs again each time, in as many parts as that machine would have. On the cores of this one
the search runs again, to compare.
"""

from __future__ import annotations

import heapq
import itertools
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

import pandas as pd

from expdesign.configuration import load_run
from expdesign.experiment.setup import plan_search
from expdesign.solver import search as searching
from expdesign.solver.starts import SearchPlan
from expdesign.workers import Job, JobRunner, Monitor

TITLE = "Search on many workers"
SECTIONS = {"normal": 1, "thorough": 1}
"""Number of seeds by effort."""
WORKERS = (1, 2, 4, 8, 16, 32, 64)

Timed = dict[tuple[str, str, int], tuple[Any, float]]
"""Result and seconds of jobs by name, function and, for a finish, number of its start."""


def rows(section: str, repetitions: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield one row per seed and number of workers."""
    for seed in range(repetitions or SECTIONS[section]):
        configuration = load_run("palida").with_search(section, seed)
        build = partial(plan_search, configuration)
        plan = replace(build(), workers=1)
        plan.problem.compile()
        timed: Timed = {}
        _search(JobRunner, build, replace(plan, starts=1, hops=1))  # imports and compiles
        seconds, found = _search(partial(_TimingRunner, timed), build, plan)
        real = {1: seconds}
        first = 0.0
        for workers in WORKERS:
            simulated = _SimulatedRunner(timed, workers)
            runner, present = mock.Mock(return_value=simulated), replace(plan, workers=workers)
            _, same = _search(runner, build, present)
            if same.trajectory.vector().tobytes() != found.trajectory.vector().tobytes():
                raise AssertionError(f"{workers} workers find another motion")
            if 1 < workers <= (os.cpu_count() or 1):
                real[workers], _ = _search(JobRunner, build, present)
            first = first or simulated.now
            yield {
                "seed": seed,
                "workers": workers,
                "simulated seconds": round(simulated.now, 2),
                "measured seconds": round(real[workers], 2) if workers in real else "",
                "times faster": round(first / simulated.now, 1),
                "seconds until the finish": round(simulated.ends[-3], 2),
                "seconds of the finish": round(simulated.ends[-2] - simulated.ends[-3], 2),
                "seconds of the proof": round(simulated.ends[-1] - simulated.ends[-2], 2),
            }


def summary(table: pd.DataFrame) -> str:
    """Return how much faster many workers are."""
    middle = table.groupby("workers")["times faster"].median()
    return "times faster than one worker, median: " + ", ".join(
        f"{faster:g} on {workers}" for workers, faster in middle.items()
    )


def _search(
    runner: Callable[..., Any], build: Callable[[], SearchPlan], plan: SearchPlan
) -> tuple[float, searching.SearchResult]:
    """Return the time of a search, s, and its result."""
    began = time.perf_counter()
    with mock.patch.object(searching, "JobRunner", runner):
        found = searching.search(build, plan, Monitor())
    return time.perf_counter() - began, found


def _key(job: Job) -> tuple[str, str, int]:
    return job.name, job.function.__name__, job.arguments[0].index


class _TimingRunner(JobRunner):
    """Runs jobs in this process and keeps their results and times."""

    def __init__(self, timed: Timed, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._timed = timed

    def run(
        self,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] = lambda _result: None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in their order."""
        waiting = deque(jobs)
        while waiting:
            job = waiting.popleft()
            before = self.cpu_seconds
            (result,) = super().run([job], monitor, after_stop=after_stop)
            self._timed[_key(job)] = result, self.cpu_seconds - before
            following = then(result)
            if following is not None:
                waiting.append(following)
            yield result


class _SimulatedRunner:
    """Returns known results of jobs by the clock of a machine with a core for every worker.

    Attributes
    ----------
    now : float
        Time of that clock, s.
    ends : list of float
        Times at which lists of jobs were done, s.
    """

    cpu_seconds, lost = 0.0, None

    def __init__(self, timed: Timed, workers: int) -> None:
        self._timed, self._workers = timed, workers
        self.now, self.ends = 0.0, list[float]()
        self._leading: Any = None
        """What the job in this process has built; None: there is none."""
        self._spent = 0.0

    def run_here(self, built: Any, job: Job, monitor: Monitor) -> Any:
        """Run a job whose own jobs follow the clock, and add its processor time to it."""
        self._leading, self._spent, began = built, 0.0, time.process_time()
        result = job.function(built, monitor, *job.arguments)
        self.now += time.process_time() - began - self._spent
        self._leading = None
        self.ends.append(self.now)
        return result

    def _result(self, job: Job) -> tuple[Any, float]:
        """Return the known result of a job and its seconds; a part of the proof is computed."""
        if self._leading is None:
            return self._timed[_key(job)]
        began = time.process_time()
        result = job.function(self._leading, Monitor(), *job.arguments)
        seconds = time.process_time() - began
        self._spent += seconds
        return result, seconds

    def run(
        self,
        jobs: Sequence[Job],
        _monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] = lambda _result: None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in the order of every lane."""
        del after_stop
        waiting, numbers = deque(jobs), itertools.count()
        busy: list[tuple[float, int, tuple[int, int], Any]] = []
        arrived: dict[tuple[int, int], Any] = {}
        begun, following = Counter[int](), Counter[int]()
        while waiting or busy:
            while waiting and len(busy) < self._workers:
                job = waiting.popleft()
                result, seconds = self._result(job)
                place = job.lane, begun[job.lane]
                begun[job.lane] += 1
                heapq.heappush(busy, (self.now + seconds, next(numbers), place, result))
            self.now, _, place, result = heapq.heappop(busy)
            arrived[place] = result
            lane = place[0]
            while (lane, following[lane]) in arrived:
                result = arrived.pop((lane, following[lane]))
                following[lane] += 1
                after = then(result)
                if after is not None:
                    waiting.append(after)
                yield result
        if self._leading is None:
            self.ends.append(self.now)
