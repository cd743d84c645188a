"""The phases of one start: friction and criterion continued from blunt to sharp.

A phase solves programs with few rows: violated rows are added until none is left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.information.criteria import Criterion, criteria
from expdesign.problem.design_problem import DesignProblem
from expdesign.runfolder import OpenNumber, described
from expdesign.solver import interior_point
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor

MOST_BLUNT_HARMONICS = 5
"""Largest number of harmonics of the first phase: with many it got stuck far from the best."""
_EVERYTHING = 10.0
_NEAR = 0.15
_RADIUS = 0.6
_PERTURBED = 0.03
"""First barrier of a hop: the larger, the farther from the perturbed motion it may end."""
_SETTLED = 1e-3
"""First barrier of a phase that begins near its optimum: from 0.01 it goes far away and returns."""
_ROUGH = interior_point.Standstill(1e-3, 3)
"""A third of the iterations less, and refinements end at the same optima (47 starts)."""
_FINISH_NEAR = 0.1
_FINISH_RADIUS = 0.2
_LAST_NEAR, _LAST_RADIUS = 0.03, 0.05
"""For Ipopt's round. In a larger box it wanders off to where omitted rows are violated; with three
times the rows its linear algebra takes three times as long (measured). For five harmonics; with
more, a step of the same size changes accelerations more, and more rows are near."""
_FINISHED = 1e-4
"""First barrier of the finish, which begins at an optimum: as `_SETTLED`."""


@dataclass(frozen=True)
class Phase:
    """Settings of one phase."""

    name: str
    width: float
    """Smoothing of dry friction, m/s."""
    level: float
    """Sharpness of the criterion's surrogate."""
    samples: int
    """Samples of one period in the cost."""
    points: int
    """Points of one period at which limits are imposed."""
    near: float
    """Rows closer to their bounds than this share of their range enter the program at once."""
    radius: float | None
    """Half-width of the box about the start of the phase, in scaled variables."""
    iterations: int
    """Largest number of iterations."""
    barrier: float = 0.1
    """Initial barrier of the interior point method."""
    renewed: int | None = None
    """Iterations that share the cost's own Hessian; None: all."""
    standstill: interior_point.Standstill = interior_point.STANDSTILL
    criterion: Criterion | None = None
    """Criterion instead of the problem's own."""
    harmonics: int | None = None
    """Number of harmonics if smaller than the problem's."""
    rounds: int = 0
    """Largest number of solves, each with all iterations; 0: they share the iterations."""


@dataclass(frozen=True)
class PhaseResult:
    """Settings of a phase, statistics of its solves and the status of the last one."""

    name: str
    width: float
    level: float
    samples: int
    rows: int = 0
    rounds: int = 0
    iterations: int = 0
    evaluations: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    status: str = ""
    converged: bool = False
    objective: float = np.nan
    violation: float = np.nan

    @classmethod
    def start(cls, phase: Phase) -> PhaseResult:
        """Return the result of a phase before its first solve."""
        return cls(phase.name, phase.width, phase.level, phase.samples)

    def add(self, solution: interior_point.Solution, rows: int) -> PhaseResult:
        """Return the result after one more solve, of a program with so many rows."""
        return replace(
            self,
            rows=rows,
            rounds=self.rounds + 1,
            iterations=self.iterations + solution.iterations,
            evaluations={
                key: self.evaluations.get(key, 0) + value
                for key, value in solution.evaluations.items()
            },
            seconds=self.seconds + solution.seconds,
            status=solution.status,
            converged=solution.converged,
        )


PhaseReport = Callable[[PhaseResult, int], interior_point.IterationReport | None]
"""(result of the phase before a round, largest number of the round's iterations) → the report of
its iterations; None: no report."""


def coarse_points(harmonics: int) -> int:
    """Return the points per period that resolve the limits for a blunt phase.

    Examples
    --------
    >>> coarse_points(5), fine_points(5)
    (48, 100)
    """
    return 8 * harmonics + 8


def fine_points(harmonics: int) -> int:
    """Return the points per period of the sharp phases and of the finish."""
    return 16 * harmonics + 20


def continuation_phases(
    problem: DesignProblem, widths: Sequence[float], iterations: int
) -> list[Phase]:
    """Return the phases of one start.

    The first one imposes every limit on a coarse grid with blunt friction: it finds the basin. The
    others begin at its result, so that only rows near their bounds need to be in the program.
    With many harmonics the first phase has only some of them. The others begin at zero, and the
    next phase imposes every limit too: they move far before any limit is near its bound.
    For a criterion that is flat where a parameter is hardly excited the first phase maximises
    log det F instead; after it the condition number's optimum is out of reach (measured). The
    surrogate of a criterion is sharpened over the other phases; its last levels follow at the last
    width. `widths` of the smoothing of dry friction, m/s, decrease.
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    few = min(n, MOST_BLUNT_HARMONICS)
    levels = problem.criterion.levels
    coarse, fine = coarse_points(n), fine_points(n)
    # Criteria that depend on the scaling need more iterations: one more phase on the first level.
    levels = levels if problem.criterion.invariant else (levels[0], *levels)
    # With few harmonics first, the next phase is on the coarse grid: one more on the fine one.
    count = max(len(widths), len(levels), 3 if few < n else 2)
    phases = [
        Phase(
            name="blunt",
            width=widths[0],
            level=levels[0],
            samples=min(samples, coarse_points(few)),
            points=coarse_points(few),
            near=_EVERYTHING,
            radius=None,
            iterations=iterations,
            renewed=interior_point.RENEWED,
            standstill=_ROUGH,
            criterion=criteria()["d"] if problem.criterion.flat else None,
            harmonics=few if few < n else None,
        )
    ]
    for k in range(1, count):
        # The grid goes from coarse to fine, the rows from many to those near their bounds.
        share = min(k, len(widths) - 1) / (len(widths) - 1) if len(widths) > 1 else 1.0
        points = round(coarse + share * (fine - coarse))
        near = _NEAR * (2 - share)
        if k == 1 and few < n:
            points, near = coarse, _EVERYTHING
        phases.append(
            Phase(
                name="sharp",
                width=widths[min(k, len(widths) - 1)],
                level=levels[min(k, len(levels) - 1)],
                samples=min(samples, points),
                points=points,
                near=near,
                radius=_RADIUS,
                iterations=iterations,
                barrier=_SETTLED,
            )
        )
    return phases


def hop_phases(problem: DesignProblem, widths: Sequence[float], iterations: int) -> list[Phase]:
    """Return the phases of one hop: those of a start, with fewer iterations.

    The first one imposes every limit: a perturbed motion scaled into its limits has hardly any row
    near its bound, and with few rows the solver leaves all the other limits at once (measured).
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    first, *others = continuation_phases(problem, widths, max(10, iterations // 2))
    coarse = coarse_points(n)
    perturbed = replace(
        first,
        points=coarse,
        samples=min(samples, coarse),
        barrier=_PERTURBED,
        harmonics=None,
    )
    return [perturbed, *others]


def finish_phase(problem: DesignProblem, widths: Sequence[float], iterations: int) -> Phase:
    """Return the settings of each round of the finish: a small box, the sharpest smoothing.

    The cost has twice as many samples as in the phase before: they predict better which of
    several motions will be the best (measured).
    """
    points = fine_points(problem.variables.harmonics)
    return Phase(
        name="finish",
        width=widths[-1],
        level=problem.criterion.levels[-1],
        samples=min(problem.cost.samples, 2 * points),
        points=points,
        near=_FINISH_NEAR,
        radius=_FINISH_RADIUS,
        iterations=max(10, iterations // 4),
        barrier=_FINISHED,
    )


def last_phase(phase: Phase, harmonics: int) -> Phase:
    """Return the settings of Ipopt's round, which begins at the result of the rounds before."""
    share = min(1.0, 5 / harmonics)
    return replace(phase, near=share * _LAST_NEAR, radius=share * _LAST_RADIUS)


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

    motion: FourierTrajectory | None = None
    """The motion that was reached, once it keeps the limits."""

    @property
    def is_end(self) -> bool:
        """Whether a rough search, a start or a finish has ended."""
        return self.phase in _ENDS


@dataclass(frozen=True)
class Iteration:
    """An iteration of the optimiser."""

    start: Annotated[int, described("1", "number of the start")]
    kind: Annotated[str, described("", "random, hop or origin")]
    phase: Annotated[
        str, described("", "blunt: rough search, sharp: refinement, hop, finish", name="stage")
    ]
    iteration: Annotated[int, described("1", "iteration, counted over the stages")]
    objective: Annotated[OpenNumber, described("", "smoothed criterion, as it is reported")]
    violation: Annotated[
        OpenNumber, described("1", "largest violation in the NLP, share of the limit's range")
    ]


@dataclass
class StartReporter:
    """Reports the iterations of one start, and keeps its trace."""

    monitor: Monitor
    start: int
    kind: str
    trace: list[Iteration] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)
    last_report: float = -np.inf
    """Time of the last report of an iteration, s."""

    @property
    def seconds(self) -> float:
        """Time since the beginning of the start, s."""
        return time.perf_counter() - self.began

    def report(
        self,
        phase: str,
        iteration: int,
        objective: float,
        violation: float,
        status: str = "",
        motion: FourierTrajectory | None = None,
    ) -> None:
        """Report one iteration, or the end with the motion that was reached."""
        event = SearchEvent(self.start, phase, iteration, objective, violation, self.seconds)
        self.monitor.report(replace(event, status=status, motion=motion))

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

        def round_report(done: PhaseResult, most: int) -> interior_point.IterationReport:
            def report(number: int, value: float, violation: float, _x: Array) -> bool:
                objective = cost.criterion_value(value)
                in_phase = done.iterations + number
                total = before + in_phase
                if phase.criterion is None:
                    # Values of another criterion are displayed, but they are not in the trace.
                    self.trace.append(
                        Iteration(self.start, self.kind, phase.name, total, objective, violation)
                    )
                now = time.perf_counter()
                if now - self.last_report >= _INTERVAL:
                    self.last_report = now
                    # Solvers report the start as well, before their first iteration.
                    in_round = min(number, most)
                    which, count = place
                    share = min(in_phase / phase.iterations, 1.0)
                    if phase.rounds:
                        which, count, share = done.rounds + 1, phase.rounds, in_round / most
                    self.monitor.report(
                        SearchEvent(
                            self.start,
                            phase.name,
                            total,
                            objective,
                            violation,
                            self.seconds,
                            place=(which, count),
                            of_round=(in_round, most),
                            share=(which - 1 + share) / count,
                        )
                    )
                return not self.monitor.stop_requested()

            return report

        return round_report
