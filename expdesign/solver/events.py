"""Events of a search: iterations and ends of starts, as they are reported and kept."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.phases import Report, Stage, Step
from expdesign.workers import Monitor

_OFTEN = 0.05
"""Time between two reports of iterations, s: to take them in costs time."""

STAGE_TITLES = {
    "blunt": "rough search",
    "sharp": "refinement",
    "finish": "finish",
}
"""What people call a stage of a search, by its name in files."""


@dataclass(frozen=True)
class TracePoint:
    """One iteration, for the convergence figure: objective as it is reported, violation."""

    stage: str
    iteration: int
    objective: float
    violation: float


ENDS = ("waiting", "done", "finished")
"""Phases of events that end something."""


@dataclass(frozen=True)
class SearchEvent:
    """One iteration, or the end, of one start."""

    start: int
    """Number of the start, from 1; hops go on counting."""
    phase: str
    """``"blunt"``, then ``"waiting"`` for the other starts, ``"sharp"``; then ``"done"``; for
    some ``"finish"``, then ``"finished"``."""
    iteration: int
    objective: float
    """The criterion in the units in which it is reported (log det F for ``d``): smoothed, and that
    of the unsmoothed model when it is done or finished."""
    violation: float
    """Largest violation of the limits in the NLP, as a share of their range."""
    seconds: float
    status: str = ""
    """Empty while it runs; then how it ended."""
    place: tuple[int, int] = (1, 1)
    """Number of the stage, from 1, and how many the start has; of the finish its rounds."""
    of_round: tuple[int, int] = (0, 0)
    """Number of the iteration in its round of the stage, and how many that has at most; 0: not
    known."""
    share: float = 0.0
    """How much of the start, or of the finish, is done, 0 … 1: by the iterations that it has at
    most."""


@dataclass
class Watch:
    """Reports the iterations of one start, and keeps them for the convergence figure."""

    monitor: Monitor
    start: int
    trace: list[TracePoint] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)
    told: float = -np.inf
    """When it reported an iteration for the last time."""

    @property
    def seconds(self) -> float:
        """Time since it began, s."""
        return time.perf_counter() - self.began

    def tell(
        self, phase: str, iteration: int, objective: float, violation: float, status: str = ""
    ) -> None:
        """Report one iteration, or the end."""
        self.monitor.report(
            SearchEvent(self.start, phase, iteration, objective, violation, self.seconds, status)
        )

    def of_stage(
        self, stage: Stage, problem: DesignProblem, before: int = 0, place: tuple[int, int] = (1, 1)
    ) -> Report:
        """Return what reports the iterations of a stage, after those that were `before` it.

        `place` is the stage's number, from 1, among those of the start, and how many there are.
        """
        cost = problem.cost
        if stage.criterion is not None:
            cost = problem.with_criterion(stage.criterion).cost

        def report(step: Step, value: float, violation: float) -> bool:
            readable = cost.readable(value)
            point = TracePoint(stage.name, before + step.iteration, readable, violation)
            if stage.criterion is None:
                # Another criterion's numbers are shown while it runs, and kept out of the trace.
                self.trace.append(point)
            now = time.perf_counter()
            if now - self.told < _OFTEN:
                return not self.monitor.stop_requested()
            self.told = now
            number, count = place
            done = min(step.iteration / stage.iterations, 1.0)
            if stage.rounds:
                number, count, done = step.round, stage.rounds, step.in_round / step.most
            self.monitor.report(
                SearchEvent(
                    self.start,
                    stage.name,
                    point.iteration,
                    readable,
                    violation,
                    self.seconds,
                    place=(number, count),
                    of_round=(step.in_round, step.most),
                    share=(number - 1 + done) / count,
                )
            )
            return not self.monitor.stop_requested()

        return report
