"""Searches of PaLiDA on 1 to 64 workers: their schedule with measured times of the jobs.

The search runs once in this process, where the processor time of every job is taken. Its decisions
and the same results then follow the clock of a simulated machine with any number of cores; a proof
that is not done ahead runs again each time, in as many parts as that machine would have. Jobs ahead
whose results are not used take the median time of their kind. The time of the process that
distributes the jobs, and of starting workers, is not simulated. On the cores of this machine the
search runs again, to compare.
"""

from __future__ import annotations

import heapq
import itertools
import os
import statistics
import time
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
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
from expdesign.workers.ahead import Foresee

TITLE = "Search on many workers"
SECTIONS = {"normal": 1, "thorough": 1}
"""Number of seeds by effort."""
WORKERS = (1, 2, 4, 8, 16, 32, 64)

Key = tuple[str, int, bytes]
"""Function of a job, number and variables of its start."""
Timed = dict[Key, tuple[Any, float]]
"""Result and seconds of jobs."""


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
                "seconds until the finish": round(simulated.began["polish_start"], 2),
                "seconds until the proof": round(simulated.began["prove_limits"], 2),
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


def _key(job: Job) -> Key:
    start = job.arguments[0]
    return job.function.__name__, start.index, start.variables.tobytes()


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
        then: Callable[[Any], Job | None] | None = None,
        foresee: Foresee | None = None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in their order."""
        del foresee
        waiting = deque(jobs)
        while waiting:
            job = waiting.popleft()
            before = self.cpu_seconds
            (result,) = super().run([job], monitor, after_stop=after_stop)
            self._timed[_key(job)] = result, self.cpu_seconds - before
            following = then(result) if then else None
            if following is not None:
                waiting.append(following)
            yield result


class _SimulatedRunner:
    """Returns known results of jobs by the clock of a machine with a core for every worker.

    Attributes
    ----------
    now : float
        Time of that clock, s.
    began : dict
        Times at which required jobs of a function began last, s.
    """

    cpu_seconds, lost = 0.0, None

    def __init__(self, timed: Timed, workers: int) -> None:
        self._timed, self._workers = timed, workers
        self.now, self.began = 0.0, dict[str, float]()
        self._ahead: dict[Key, float] = {}
        """Times at which the jobs ahead end."""
        self._begun, self._known = set[Key](), dict[Key, Any]()
        self._leading: Any = None
        """What the job in this process has built; None: there is none."""
        self._mark, self._companions = 0.0, 0.0
        """Processor time up to which the clock has run, and the end of the companions, s."""

    def lead(
        self, built: Any, job: Job, monitor: Monitor, companions: Sequence[Job], foresee: Foresee
    ) -> None:
        """Run a job whose own jobs follow the clock, while workers do others."""
        keys = [_key(one) for one in companions]
        ends = [self._ahead.get(key, self.now + self._seconds(key)) for key in keys]
        self._ahead, self._companions = {}, max(ends, default=self.now)
        self._known.update({key: self._timed[key][0] for key in keys if key in self._timed})
        if _key(job) in map(_key, foresee(self.known, True)):
            self.began[job.function.__name__] = self.now
            self._leading, self._mark = built, time.process_time()
            self._known[_key(job)] = job.function(built, monitor, *job.arguments)
            self._take_own_time()
            self._leading = None
        self.now = max(self.now, self._companions)

    def _seconds(self, key: Key) -> float:
        """Return the time of a job; if its result is not used, the median one of its function."""
        alike = (seconds for one, (_, seconds) in self._timed.items() if one[0] == key[0])
        return self._timed[key][1] if key in self._timed else statistics.median(alike)

    def _take_own_time(self) -> None:
        """Add the processor time of the job in this process to the clock."""
        now = time.process_time()
        self.now, self._mark = self.now + now - self._mark, now

    @property
    def free(self) -> int:
        """Number of workers without a job of `lead`."""
        self._take_own_time()
        return self._workers - (self._companions > self.now)

    def has_begun(self, job: Job) -> bool:
        """Return whether a job has begun ahead, or its result is known."""
        return _key(job) in self._begun | self._known.keys()

    def known(self, job: Job) -> Any:
        """Return the result of a job, or None."""
        return self._known.get(_key(job))

    def close(self) -> None:
        """End the jobs ahead."""
        self._ahead.clear()

    def _result(self, job: Job) -> tuple[Any, float]:
        """Return the known result of a job and its seconds; a part of the proof is computed."""
        if self._leading is None:
            return self._timed[_key(job)]
        result = job.function(self._leading, Monitor(), *job.arguments)
        now = time.process_time()
        seconds, self._mark = now - self._mark, now
        return result, seconds

    def run(
        self,
        jobs: Sequence[Job],
        _monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] | None = None,
        foresee: Foresee | None = None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in the order of every lane, as `expdesign.workers` does."""
        del after_stop
        if self._leading is not None:
            self._take_own_time()
        waiting, numbers, left = deque(jobs), itertools.count(), len(jobs) if then else 0
        busy: list[tuple[float, int, tuple[int, int], Key | None, Any]] = []
        arrived: dict[tuple[int, int], Any] = {}
        begun, following, required = Counter[int](), Counter[int](), set[Key]()
        while waiting or busy:
            while waiting:
                key = _key(waiting[0]) if foresee else None
                is_free = self.has_begun(waiting[0]) if key else False
                is_free = is_free or len(busy) + len(self._ahead) < self._workers
                if not is_free and not self._end_one(()):
                    break
                job = waiting.popleft()
                self.began[job.function.__name__] = self.now
                result, seconds = self._result(job)
                end = self.now + (0.0 if key in self._known else seconds)
                end = self._ahead.pop(key, end) if key else end
                place = job.lane, begun[job.lane]
                begun[job.lane] += 1
                if key:
                    required.add(key)
                heapq.heappush(busy, (end, next(numbers), place, key, result))
            if foresee and len(busy) < self._workers:
                is_idle_for_long = max(left, len(busy)) < self._workers
                foreseen = foresee(self.known, is_idle_for_long)
                self._begin_ahead(foreseen, required, self._workers - len(busy))
            first = min(self._ahead, key=self._ahead.__getitem__, default=None)
            if first is not None and self._ahead[first] < busy[0][0]:
                self.now = max(self.now, self._ahead.pop(first))
                if first in self._timed:
                    self._known[first] = self._timed[first][0]
                continue
            end, _, place, key, result = heapq.heappop(busy)
            self.now = max(self.now, end)
            if key:
                self._known[key] = result
            arrived[place] = result
            lane = place[0]
            while (lane, following[lane]) in arrived:
                result = arrived.pop((lane, following[lane]))
                following[lane] += 1
                after = then(result) if then else None
                if after is not None:
                    waiting.append(after)
                elif then:
                    left -= 1
                yield result

    def _begin_ahead(self, foreseen: Iterable[Job], required: set[Key], room: int) -> None:
        """Begin the jobs that are foreseen and for which there is room."""
        keys = (key for key in map(_key, foreseen) if key not in required)
        wanted = dict.fromkeys(itertools.islice(keys, self._workers))
        for key in wanted:
            if key in self._begun:
                continue
            if len(self._ahead) >= room and not self._end_one(wanted):
                return
            self._ahead[key] = self.now + self._seconds(key)
            self._begun.add(key)

    def _end_one(self, kept: Container[Key]) -> bool:
        """End the job ahead that began last, of those that are not kept."""
        key = next((one for one in reversed(self._ahead) if one not in kept), None)
        if key is None:
            return False
        del self._ahead[key]
        self._begun.discard(key)
        return True
