"""One start of the search: from a random or given trajectory through all stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from constraints.arrays import Array
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.certificate import recheck
from expdesign.recheck.information import Evaluator
from expdesign.solver.finish import Shrunk, shrink_to_limits
from expdesign.solver.stage import Stage, StageRecord, TracePoint, Watch, run_stage

_BEHIND = {"hop": 0.03, "sharp": 0.01}
"""Cost by which a hop may be behind. One per cent: the finish was seen to gain so unevenly."""


@dataclass(frozen=True)
class StartResult:
    """Where one start (or hop) ended, and how."""

    index: int
    """From 1; hops go on counting."""
    kind: str
    """``"random"`` or ``"hop"``."""
    variables: Array
    """(z,), scaled, that were reached."""
    merit: float
    """The judged criterion, larger is better, of the motion shrunk until it keeps every limit;
    −inf when it cannot be."""
    status: str
    """How the last stage ended, in words."""
    converged: bool = False
    stages: tuple[StageRecord, ...] = ()
    trace: tuple[TracePoint, ...] = ()
    seconds: float = 0.0

    @property
    def iterations(self) -> int:
        """Iterations of all stages."""
        return sum(stage.iterations for stage in self.stages)


GIVEN_UP = "given up: far behind what the best motions had reached at this stage"
"""How a hop or a new start ended that was not worth going on."""

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
    """Return Ipopt's status in words."""
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

    def hopeless(self, record: StageRecord) -> bool:
        """Tell whether it is too far behind what the reference had reached at the same stage.

        A later stage says more about the finished motion than an earlier one, and is stricter.
        """
        same_problem = attrgetter("name", "width", "level", "samples")
        alike = [one for one in self.reference if same_problem(one) == same_problem(record)]
        return bool(alike) and record.objective > alike[-1].objective + _BEHIND[record.name]


def run_start(
    problem: DesignProblem,
    evaluator: Evaluator,
    stages: Sequence[Stage],
    start: Array,
    kind: str,
    watch: Watch,
    screening: Screening | None = None,
) -> StartResult:
    """Run the stages from `start` and judge what they reach by the unsmoothed model.

    `start` has the harmonics of the first stage. With a `screening` a motion that is given up
    has no merit (−inf).
    """
    records: list[StageRecord] = []
    x, done, hopeless = start, 0, False
    harmonics = problem.variables.harmonics
    present = problem.with_variables(harmonics=stages[0].harmonics or harmonics)
    for number, stage in enumerate(stages, start=1):
        wanted = stage.harmonics or harmonics
        x = present.variables.extended(x, wanted)
        present = problem.with_variables(harmonics=wanted)
        report = watch.of_stage(stage, problem, done, (number, len(stages)))
        x, record = run_stage(present, stage, x, report)
        records.append(record)
        done += record.iterations
        hopeless = screening is not None and screening.hopeless(record)
        if hopeless or watch.monitor.stop_requested():
            break
    x = present.variables.extended(x, harmonics)
    last = records[-1]
    status, merit = status_text(last.status), -np.inf
    if hopeless:
        status = GIVEN_UP
    else:
        shrunk = shrink_to_limits(problem, problem.variables.trajectory(x))
        merit = evaluator.merit(shrunk.trajectory, problem.cost.samples) if shrunk.kept else -np.inf
        if not np.isfinite(merit):
            status += f"; {_why_useless(problem, shrunk)}"
    value = merit if evaluator.criterion.larger_is_better else -merit
    index, seconds = watch.start, watch.seconds
    watch.tell("done", done, value, max(last.violation, 0.0), status)
    return StartResult(
        index, kind, x, merit, status, last.converged, tuple(records), tuple(watch.trace), seconds
    )
