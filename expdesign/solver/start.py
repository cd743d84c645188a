"""One start of the search: from a random or given trajectory through all stages."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from constraints.arrays import Array
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.certificate import recheck
from expdesign.recheck.information import Evaluator
from expdesign.solver.continuation import fine_points
from expdesign.solver.restoration import GRID_MARGIN, Shrunk, brought_within, shrink_to_limits
from expdesign.solver.solution import FEASIBLE
from expdesign.solver.stage import Stage, StageRecord, TracePoint, Watch, run_stage
from expdesign.workers import Monitor

_FINER = 4
"""Points that a start's limits are judged at, for one that they were held at."""
_BEHIND = 0.01
"""Cost by which a hop may be behind before its last stage."""


@dataclass(frozen=True)
class StartResult:
    """What one start (or hop) has reached, and how it ended; without stages: where it sets out."""

    index: int
    """From 1; hops go on counting."""
    kind: str
    """``"random"`` or ``"hop"``."""
    variables: Array
    """(z,), scaled, that were reached; before the first stage those of its harmonics."""
    merit: float = -np.inf
    """The judged criterion, larger is better, of the motion shrunk until it keeps every limit at a
    few hundred points; −inf when it cannot be, or has not been."""
    status: str = ""
    """How it ended, in words; empty while stages are left."""
    converged: bool = False
    stages: tuple[StageRecord, ...] = ()
    trace: tuple[TracePoint, ...] = ()
    seconds: float = 0.0

    @property
    def iterations(self) -> int:
        """Iterations of all stages."""
        return sum(stage.iterations for stage in self.stages)

    @property
    def rank(self) -> tuple[bool, int, bool, float]:
        """Larger is better.

        Of motions after as many stages what keeps its rows comes first, then the smoothed objective
        decides: that of another stage is another number. What is left of the criterion in a motion
        shrunk into its limits says less about the finished one: over 96 starts its rank correlation
        was 0.54, the objective's 0.89.
        """
        if not self.stages:
            return False, 0, False, -np.inf
        last, going = self.stages[-1], not self.status or self.usable
        return going, len(self.stages), last.violation <= FEASIBLE, -last.objective

    @property
    def usable(self) -> bool:
        """Whether its motion can be finished."""
        return bool(np.isfinite(self.merit))


GIVEN_UP = "given up: behind what others had reached at this stage"
"""How a start or a hop ended that was not worth going on."""

STATUS_TEXTS = {
    "Solve_Succeeded": "converged",
    "Solved_To_Acceptable_Level": "converged: the objective stood still",
    "Maximum_Iterations_Exceeded": "stopped after design.max_iterations; its best motion counts",
    "Maximum_CpuTime_Exceeded": "stopped at the time allowed",
    "User_Requested_Stop": "stopped before its end (Ctrl-C, or design.max_seconds)",
    "Infeasible_Problem_Detected": "no point nearby keeps the limits",
    "Restoration_Failed": "the limits could not be restored from where the solver stood",
    "Search_Direction_Becomes_Too_Small": "steps became too small",
    "Invalid_Number_Detected": "the model gave a value that is not a number",
}


def status_text(status: str) -> str:
    """Return the status of a solver, in Ipopt's terms, in words."""
    return STATUS_TEXTS.get(status, status.replace("_", " ").lower())


def _why_useless(problem: DesignProblem, shrunk: Shrunk) -> str:
    if shrunk.kept:
        return "its motion does not excite every parameter"
    check = recheck(problem.limits, shrunk.trajectory)
    worst = max(check.limits, key=lambda limit: limit.violation)
    return (
        f"by the unsmoothed model its motion breaks {worst.key}, even shrunk to {shrunk.factor:g} "
        "of its size"
    )


@dataclass(frozen=True)
class Screening:
    """Decides after each stage whether a hop or a new start is worth going on."""

    reference: tuple[StageRecord, ...]
    """What the motion that it is measured by had reached after its own stages."""

    def hopeless(self, record: StageRecord, *, last: bool) -> bool:
        """Tell whether it is too far behind what the reference had reached at the same stage.

        After the last one, whether it is behind at all.
        """
        same_problem = attrgetter("name", "width", "level", "samples")
        alike = [one for one in self.reference if same_problem(one) == same_problem(record)]
        allowed = 0.0 if last else _BEHIND
        return bool(alike) and record.objective > alike[-1].objective + allowed


def given_up(start: StartResult, monitor: Monitor) -> StartResult:
    """End a start that others have left behind."""
    _watch(start, monitor).tell(
        "done", start.iterations, -np.inf, start.stages[-1].violation, GIVEN_UP
    )
    return replace(start, status=GIVEN_UP)


def run_stages(
    problem: DesignProblem,
    stages: Sequence[Stage],
    begun: StartResult,
    monitor: Monitor,
    *,
    until: int | None = None,
    screening: Screening | None = None,
) -> StartResult:
    """Run the stages that are left, up to the one numbered `until`, from 1.

    A request to stop ends it after the stage that it reaches. With a `screening` it may be given
    up.
    """
    watch, result, harmonics = _watch(begun, monitor), begun, problem.variables.harmonics
    for number, stage in enumerate(stages[:until], start=1):
        if number <= len(begun.stages):
            continue
        if result.stages and monitor.stop_requested():
            break
        present = problem.with_variables(harmonics=stage.harmonics or harmonics)
        report = watch.of_stage(stage, problem, result.iterations, (number, len(stages)))
        x, record = run_stage(present, stage, result.variables, report)
        result = replace(
            result,
            variables=present.variables.extended(x, harmonics),
            converged=record.converged,
            stages=(*result.stages, record),
        )
        if screening is not None and screening.hopeless(record, last=number == len(stages)):
            return given_up(
                replace(result, trace=tuple(watch.trace), seconds=watch.seconds), monitor
            )
    return replace(result, trace=tuple(watch.trace), seconds=watch.seconds)


def judged(
    problem: DesignProblem, evaluator: Evaluator, result: StartResult, monitor: Monitor
) -> StartResult:
    """Judge by the unsmoothed model what a start has reached; what was given up stays as it is.

    It is looked at on a grid finer than the one its limits were held on, but not on the finish's:
    that would take a sixth of the search's time to tell little more of whether it can be finished.
    """
    if result.status:
        return result
    watch, last = _watch(result, monitor), result.stages[-1]
    status, merit = status_text(last.status), -np.inf
    trajectory = problem.variables.trajectory(result.variables)
    points = _FINER * fine_points(problem.variables.harmonics)
    shrunk = shrink_to_limits(problem, trajectory, points=points)
    if not shrunk.kept:
        shrunk = brought_within(problem, result.variables, GRID_MARGIN, last.width, points)
    if shrunk.kept:
        merit = evaluator.merit(shrunk.trajectory, problem.cost.samples)
    if not np.isfinite(merit):
        status += f"; {_why_useless(problem, shrunk)}"
    value = merit if evaluator.criterion.larger_is_better else -merit
    watch.tell("done", result.iterations, value, max(last.violation, 0.0), status)
    return replace(result, merit=merit, status=status, seconds=watch.seconds)


def _watch(start: StartResult, monitor: Monitor) -> Watch:
    """Return what goes on reporting a start."""
    return Watch(monitor, start.index, list(start.trace), time.perf_counter() - start.seconds)
