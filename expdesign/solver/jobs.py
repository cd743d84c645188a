"""What worker processes do: starts, hops and finishes; and the population of what they found."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.information import Evaluator
from expdesign.solver.continuation import (
    coarse_points,
    continuation_stages,
    finish_stage,
    hop_stages,
)
from expdesign.solver.finish import Finished, controller_omega, finish
from expdesign.solver.hum_distance import KnownHum
from expdesign.solver.initial import InfeasibleLimitsError, perturbed, random_start
from expdesign.solver.stage import Watch
from expdesign.solver.start import Screening, StartResult, run_start
from expdesign.workers import Monitor

_FINISH_ROUNDS = 4
CAPACITY = 3
"""Motions that are kept. From a single one a hundred hops were seen to gain 0.04 in log det F."""


@dataclass(frozen=True)
class SearchPlan:
    """How to search."""

    starts: int
    hops: int
    """After the random starts; 0: none."""
    seed: int
    widths: tuple[float, ...]
    """Smoothing of dry friction, m/s, falling."""
    iterations: int
    """At most, of a start's first stage."""
    controller_period: float
    """s."""
    hum: KnownHum
    """What the finished frequency keeps away from."""
    workers: int
    max_seconds: float | None


@dataclass(frozen=True)
class DesignTask:
    """What every worker process needs: the problem, the evaluator of its motions, and the plan."""

    problem: DesignProblem
    evaluator: Evaluator
    plan: SearchPlan


Build = Callable[[], DesignTask]
"""Builds the task inside a worker; picklable."""


@dataclass(frozen=True)
class Candidate:
    """A finished motion, what it is worth, and where it came from."""

    merit: float
    """The judged criterion, larger is better."""
    finished: Finished
    start: StartResult
    lineage: int
    """Index of the random start that it descends from."""

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Larger is better: what is certified before what passed, both by merit, then the rest."""
        check = self.finished.check
        return check.certified, check.passed, self.merit if check.passed else -check.worst


@dataclass(frozen=True)
class Population:
    """At most `CAPACITY` candidates, the best first, one of each lineage."""

    members: tuple[Candidate, ...]

    @property
    def best(self) -> Candidate:
        """The best member."""
        return self.members[0]

    @property
    def least(self) -> Candidate | None:
        """The member that a new lineage must be as good as; None while there is room."""
        passed = [member for member in self.members if member.finished.check.passed]
        return passed[-1] if len(passed) == CAPACITY else None

    def origin(self, turn: int) -> Candidate:
        """Return the member whose turn it is, counted from 0."""
        return self.members[turn % len(self.members)]

    @classmethod
    def of(cls, candidates: Iterable[Candidate]) -> Population:
        """Return the best of them, which must be of different lineages."""
        ranked = sorted(candidates, key=lambda candidate: candidate.rank, reverse=True)
        return cls(tuple(ranked[:CAPACITY]))

    def admit(self, candidate: Candidate) -> Population:
        """Return the population with a candidate, if it is good enough.

        It takes the place of its ancestor if it is better. Of a new lineage it joins, and the
        worst leaves if there are too many.
        """
        others = [member for member in self.members if member.lineage != candidate.lineage]
        same = [member for member in self.members if member.lineage == candidate.lineage]
        if same and same[0].rank >= candidate.rank:
            return self
        return Population.of([*others, candidate])


def random_job(
    task: DesignTask, monitor: Monitor, index: int, screening: Screening | None = None
) -> StartResult:
    """Start from a random motion; with a `screening` it may be given up."""
    problem, plan = task.problem, task.plan
    stages = continuation_stages(problem, plan.widths, plan.iterations)
    first = problem.with_variables(harmonics=stages[0].harmonics or problem.variables.harmonics)
    points = coarse_points(first.variables.harmonics)
    try:
        start = random_start(first, _rng(plan.seed, index), points, plan.widths[0])
    except InfeasibleLimitsError as error:
        # No shrinking brings it within the limits.
        Watch(monitor, index).tell("done", 0, -np.inf, np.inf, str(error))
        nowhere = np.full(problem.variables.size, np.nan)
        return StartResult(index, "random", nowhere, -np.inf, str(error))
    watch = Watch(monitor, index)
    return run_start(problem, task.evaluator, stages, start, "random", watch, screening)


def newcomer_job(
    task: DesignTask, monitor: Monitor, index: int, screening: Screening
) -> tuple[StartResult, Candidate | None]:
    """Start from a random motion, and finish what is not given up."""
    result = random_job(task, monitor, index, screening)
    return _finished(task, monitor, result, lineage=index)


def hop_job(
    task: DesignTask, monitor: Monitor, index: int, origin: Candidate
) -> tuple[StartResult, Candidate | None]:
    """Hop, and finish what is not given up: only finished motions can be compared."""
    problem, plan = task.problem, task.plan
    start = problem.variables.pack(origin.finished.trajectory)
    start = perturbed(problem, start, _rng(plan.seed, index), plan.widths[-1])
    stages, watch = hop_stages(problem, plan.widths, plan.iterations), Watch(monitor, index)
    screening = Screening(origin.start.stages)
    result = run_start(problem, task.evaluator, stages, start, "hop", watch, screening)
    return _finished(task, monitor, result, origin.lineage)


def finish_job(
    task: DesignTask, monitor: Monitor, index: int, variables: Array, *, proving: bool = False
) -> tuple[float, Finished]:
    """Finish what a start reached; return what it is worth, too.

    Most motions are only compared with others: see `proving` of `finish`.
    """
    problem, plan = task.problem, task.plan
    watch = Watch(monitor, index)
    omega = problem.variables.trajectory(variables).omega
    bounds = problem.variables.omega_bounds
    if bounds[0] < bounds[1]:
        omega, _ = controller_omega(omega, bounds, plan.controller_period, plan.hum)
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    stage = finish_stage(problem, plan.widths, plan.iterations)
    report = watch.of_stage(replace(stage, rounds=_FINISH_ROUNDS), problem)
    rounds = 0 if monitor.stop_requested() else _FINISH_ROUNDS
    finished = finish(
        fixed, task.evaluator, variables, stage, rounds=rounds, report=report, proving=proving
    )
    merit = task.evaluator.merit(finished.trajectory, problem.cost.samples)
    value = merit if task.evaluator.criterion.larger_is_better else -merit
    status = "every limit kept" if finished.check.passed else "a limit is broken"
    watch.tell("finished", len(watch.trace), value, finished.check.worst, status)
    return merit, replace(finished, trace=tuple(watch.trace))


def proof_job(
    task: DesignTask, monitor: Monitor, index: int, finished: Finished
) -> tuple[float, Finished]:
    """Finish once more what was finished without a proof, and prove it."""
    variables = task.problem.variables.pack(finished.trajectory)
    return finish_job(task, monitor, index, variables, proving=True)


def _finished(
    task: DesignTask, monitor: Monitor, result: StartResult, lineage: int
) -> tuple[StartResult, Candidate | None]:
    if not np.isfinite(result.merit) or monitor.stop_requested():
        return result, None
    merit, finished = finish_job(task, monitor, result.index, result.variables)
    return result, Candidate(merit, finished, result, lineage)


def _rng(seed: int, index: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
