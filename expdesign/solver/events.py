"""Events of a search: iterations and ends of starts, reported to a display and kept as a trace."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.phases import Phase, PhaseIteration, PhaseReport
from expdesign.workers import Monitor

PHASE_TITLES = {
    "blunt": "rough search",
    "sharp": "refinement",
    "finish": "finish",
}
"""Titles of the phases of a search, by their names in files."""

_INTERVAL = 0.05
"""Smallest time between two reports of iterations, s: receiving them costs time."""
_ENDS = ("waiting", "done", "finished")


@dataclass(frozen=True)
class SearchEvent:
    """One iteration, or the end, of one start."""

    start: int
    """Number of the start, from 1; hops continue the numbers."""
    phase: str
    """``"blunt"``, then ``"waiting"`` for the other starts, ``"sharp"``; then ``"done"``; for
    some ``"finish"``, then ``"finished"``."""
    iteration: int
    objective: float
    """The criterion in its reported units (log det F for ``d``): smoothed during a phase, exact at
    ``"done"`` and ``"finished"``."""
    violation: float
    """Largest violation of the limits in the program, as a share of their range."""
    seconds: float
    status: str = ""
    """How the start ended, in words; empty while it runs."""
    place: tuple[int, int] = (1, 1)
    """Number of the phase, from 1, and of all phases of the start; rounds in the finish."""
    of_round: tuple[int, int] = (0, 0)
    """Number of the iteration in its round, and the largest number in the round; 0: unknown."""
    share: float = 0.0
    """Progress of the start, or of the finish, 0 … 1, relative to the largest number of
    iterations."""

    @property
    def is_end(self) -> bool:
        """Whether a rough search, a start or a finish has ended."""
        return self.phase in _ENDS


@dataclass(frozen=True)
class TracePoint:
    """One iteration: the objective in its reported units, and the violation."""

    phase: str
    iteration: int
    objective: float
    violation: float


@dataclass
class StartReporter:
    """Reports the iterations of one start, and keeps its trace."""

    monitor: Monitor
    start: int
    trace: list[TracePoint] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)
    last_report: float = -np.inf
    """Time of the last report of an iteration, s."""

    @property
    def seconds(self) -> float:
        """Time since the beginning of the start, s."""
        return time.perf_counter() - self.began

    def report(
        self, phase: str, iteration: int, objective: float, violation: float, status: str = ""
    ) -> None:
        """Report one iteration, or the end."""
        self.monitor.report(
            SearchEvent(self.start, phase, iteration, objective, violation, self.seconds, status)
        )

    def phase_report(
        self,
        phase: Phase,
        problem: DesignProblem,
        before: int = 0,
        place: tuple[int, int] = (1, 1),
    ) -> PhaseReport:
        """Return the report of a phase's iterations.

        Parameters
        ----------
        before : int
            Iterations of the phases before.
        place : (int, int)
            Number of the phase, from 1, and of all phases of the start.
        """
        cost = problem.cost
        if phase.criterion is not None:
            cost = problem.with_criterion(phase.criterion).cost

        def report(number: PhaseIteration, value: float, violation: float) -> bool:
            objective = cost.criterion_value(value)
            point = TracePoint(phase.name, before + number.iteration, objective, violation)
            if phase.criterion is None:
                # Values of another criterion are displayed, but they are not in the trace.
                self.trace.append(point)
            now = time.perf_counter()
            if now - self.last_report < _INTERVAL:
                return not self.monitor.stop_requested()
            self.last_report = now
            which, count = place
            done = min(number.iteration / phase.iterations, 1.0)
            if phase.rounds:
                which, count, done = number.round, phase.rounds, number.in_round / number.most
            self.monitor.report(
                SearchEvent(
                    self.start,
                    phase.name,
                    point.iteration,
                    objective,
                    violation,
                    self.seconds,
                    place=(which, count),
                    of_round=(number.in_round, number.most),
                    share=(which - 1 + done) / count,
                )
            )
            return not self.monitor.stop_requested()

        return report
