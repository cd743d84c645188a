"""The finish of a design: whole controller steps, and every limit kept between the samples.

The optimiser imposes smoothed limits at some points. Here the frequency is changed so that a period
is a whole number of controller steps, and the coefficients are solved for again at that ω, with
margins where the exact model on a fine grid exceeds the smoothed one. Small remaining violations
are removed by the least change of the coefficients (`expdesign.solver.feasibility`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.enclosure.limit_rows import EnclosedLimits
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.problem.design_problem import DesignProblem
from expdesign.problem.program import smoothing_gap
from expdesign.recheck.certificate import CellBounds, Cells, bound_cells, recheck
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.limit_check import (
    TOLERANCE,
    Recheck,
    grid_points,
    local_worst,
    worst_sampled,
)
from expdesign.solver import phases
from expdesign.solver.feasibility import GRID_MARGIN, LARGEST_MARGIN, restore_limits
from expdesign.solver.interior_point import solve_by_interior_point
from expdesign.solver.ipopt import last_options, solve_with_ipopt
from expdesign.solver.starts import SearchPlan, StartResult, solve_phase
from expdesign.trajectory import round_period
from expdesign.workers import Job, Monitor, Procedure

_ROUNDS = 4
_MOST_REPETITIONS = 4
"""Largest number of further refinements and finishes of the best motion."""
_GAIN = 1e-4
"""Gain per parameter, as a logarithm, that justifies another one."""
_CHECKS = 4
_WORTHWHILE = 2e-3


def polish_start(
    plan: SearchPlan,
    monitor: Monitor,
    start: StartResult,
    *,
    proving: bool = False,
    settled: bool = False,
) -> StartResult:
    """Finish the motion that a start has reached.

    Most motions are only compared with others: see `proving` and `settled` of `polish`.
    """
    problem = plan.problem
    reporter = phases.StartReporter(monitor, start.index, start.kind)
    omega = problem.variables.trajectory(start.variables).omega
    bounds = problem.variables.omega_bounds
    if bounds[0] < bounds[1]:
        omega, _ = round_period(omega, bounds, plan.controller_period, plan.hum)
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    phase = phases.finish_phase(problem, plan.widths, plan.iterations)
    polished = polish(
        fixed,
        plan.evaluator,
        start.variables,
        phase,
        rounds=0 if monitor.stop_requested() else _ROUNDS,
        report=reporter.phase_report(replace(phase, rounds=_ROUNDS), problem),
        proving=proving,
        settled=settled,
    )
    value = polished.merit if plan.evaluator.criterion.larger_is_better else -polished.merit
    where = "" if proving else " on the fine grid"
    status = f"every limit kept{where}" if polished.check.passed else "a limit is broken"
    reporter.report(
        "finished",
        len(reporter.trace),
        value,
        polished.check.worst,
        status,
        polished.trajectory if polished.check.passed else None,
    )
    return replace(polished, index=start.index, status=status, trace=tuple(reporter.trace))


def prove_design(plan: SearchPlan, monitor: Monitor, polished: StartResult) -> Procedure:
    """Finish a motion again as long as it improves, then once more with a proof of its limits.

    If the improved motion cannot be proved, but the given one can, the given one is returned.
    """
    again = polished
    # A search without hops is meant to be short.
    for _ in range(_MOST_REPETITIONS if plan.hops else 0):
        (result,) = yield [Job(polish_again, (again,), expected=again)]
        gain = plan.evaluator.gain(result.merit, again.merit)
        if not (result.check.passed and (gain > _GAIN or not again.check.passed)):
            break
        again = result
    (proved,) = yield [Job(prove_limits, (again,))]
    if again is not polished and not (proved.check.certified or monitor.stop_requested()):
        (before,) = yield [Job(prove_limits, (polished,))]
        if before.check.certified:
            return before
    return proved


def polish_again(plan: SearchPlan, monitor: Monitor, polished: StartResult) -> StartResult:
    """Refine and finish a finished motion again.

    The refinement's box is larger, and it has no margins: it leaves the point where a finish got
    stuck.
    """
    problem = plan.problem
    own = phases.finish_phase(problem, plan.widths, plan.iterations)
    last = phases.continuation_phases(problem, plan.widths, plan.iterations)[-1]
    last = replace(last, name=own.name, samples=own.samples)
    reporter = phases.StartReporter(monitor, polished.index, polished.kind)
    report = reporter.phase_report(last, problem)
    x, _ = solve_phase(problem, last, polished.variables, report)
    if monitor.stop_requested():
        return polished
    return polish_start(plan, monitor, replace(polished, variables=x))


def prove_limits(plan: SearchPlan, monitor: Monitor, polished: StartResult) -> StartResult:
    """Finish a motion once more, now with a proof of its limits."""
    return polish_start(plan, monitor, polished, proving=True, settled=polished.converged)


def bound_part(
    plan: SearchPlan, _monitor: Monitor, motion: EnclosedSeries, cells: Cells
) -> CellBounds:
    """Bound the limits of a motion in a part of the cells of a proof."""
    return bound_cells(EnclosedLimits(plan.problem.limits), motion, cells)


def polish(
    problem: DesignProblem,
    evaluator: Evaluator,
    start: Array,
    phase: phases.Phase,
    *,
    rounds: int,
    report: phases.PhaseReport,
    proving: bool = True,
    settled: bool = False,
) -> StartResult:
    """Bring a solution within the limits between the samples as well.

    Parameters
    ----------
    problem : DesignProblem
        Both bounds of ω are the value wanted.
    evaluator : Evaluator
        Decides which round's trajectory is the best.
    start : (z,)
        Scaled variables.
    phase : Phase
        Settings of each solve.
    rounds : int
        Largest number of solves.
    report : callable
        Gets every iteration.
    proving : bool
        Whether limits are proved after each solve, the last solve being Ipopt's; otherwise they
        are checked on the fine grid, to compare motions with one another.
    settled : bool
        Whether `start` was finished before, without a proof: the first solve may be the last.
    """
    x = start.copy()
    x[-1] = problem.variables.bounds()[0][-1]
    # A settled motion is proved only if Ipopt's round does not improve on it.
    proved = proving and not (settled and rounds)
    best, exact = _check(problem, evaluator, x, phase.width, proving=proved)
    candidate, kept = best, x
    result, last_merit = phases.PhaseResult.start(phase), best.merit
    # Worst moments of earlier rounds stay: without their rows their violations come back.
    seen: Mask = np.zeros((grid_points(problem.cost.samples), len(problem.limits.keys)), dtype=bool)
    for number in range(1, rounds + 1):
        last = number == rounds or settled
        # Each round has all iterations of the phase: rows and margins are new. Ipopt, from the
        # optimum of a slightly different program, sometimes needs twice as many.
        ipopt = proving and last
        present = phases.last_phase(phase, problem.variables.harmonics) if ipopt else phase
        instants, mask, margins = _critical_rows(problem, x, exact, present, candidate.check, seen)
        rows = int(np.count_nonzero(mask))
        program = problem.program(
            instants,
            mask,
            width=present.width,
            level=present.level,
            samples=present.samples,
            margins=margins,
            box=(x, present.radius),
        )
        most = (1 + ipopt) * phase.iterations
        watch = report(result, most)
        if ipopt:
            solution = solve_with_ipopt(
                program,
                x,
                options=last_options(rows, most),
                report=watch,
            )
        else:
            solution = solve_by_interior_point(
                program,
                x,
                most=most,
                barrier=present.barrier,
                renewed=present.renewed,
                standstill=present.standstill,
                report=watch,
            )
        x = solution.usable
        result = result.add(solution, rows)
        candidate, exact = _check(problem, evaluator, x, phase.width, proving=proving)
        gain = evaluator.gain(candidate.merit, best.merit)
        if proving and not proved and (gain <= 0 or not candidate.check.certified):
            (best, _), proved = _check(problem, evaluator, kept, phase.width, proving=True), True
            gain = evaluator.gain(candidate.merit, best.merit)
        standing, before = (
            (check.certified, check.passed) for check in (candidate.check, best.check)
        )
        if standing > before or (standing == before and candidate.check.passed and gain > 0):
            best, kept, proved = candidate, x, proving
        # A round that gets worse reveals rows and margins that the next one corrects (measured).
        good = best.check.certified if proving else best.check.passed
        stopped = solution.status == "User_Requested_Stop"
        if number == rounds or (last and good) or stopped:
            break
        settled = good and abs(evaluator.gain(candidate.merit, last_merit)) < _WORTHWHILE
        if settled and not proving:
            break
        last_merit = candidate.merit
    if result.rounds == 0:
        return best
    result = replace(
        result,
        objective=problem.cost_value(kept, phase.width, phase.level, phase.samples),
        violation=best.check.worst,
    )
    return replace(best, phases=(result,), converged=result.converged)


def _check(
    problem: DesignProblem, evaluator: Evaluator, x: Array, width: float, *, proving: bool
) -> tuple[StartResult, Array]:
    """Restore the limits until all are proved for every instant, or kept on the fine grid.

    A limit without a proof, or without one within the budget, counts with its largest value found.
    The violations before the restoration on the fine grid, (points, R), are returned as well.
    """
    margin = GRID_MARGIN
    for _ in range(_CHECKS):
        motion = restore_limits(problem, x, margin, width)
        if not proving:
            times = motion.trajectory.sample_times(grid_points(problem.cost.samples))
            check = Recheck(worst_sampled(problem.limits, times, motion.values))
            break
        check = recheck(problem.limits, motion.trajectory)
        if check.certified or not motion.kept or not TOLERANCE < check.possible < np.inf:
            break
        margin += 2 * check.possible
    merit = evaluator.merit(motion.trajectory, problem.cost.samples)
    checked = StartResult(
        0,
        "finish",
        problem.variables.pack(motion.trajectory),
        merit,
        trajectory=motion.trajectory,
        check=check,
        shrink=motion.factor,
    )
    return checked, motion.before


def _critical_rows(
    problem: DesignProblem, x: Array, exact: Array, phase: phases.Phase, check: Recheck, seen: Mask
) -> tuple[Array, Mask, Array]:
    """Choose the decisive instants, their rows and margins: (K,), (K, R), (K, R).

    The instants are a regular grid, every local worst of the exact limits on the fine grid, and
    the worst moments found by the last motion's proof where the grid shows none: two nearly equal
    rows would only make the program harder. Those of the fine grid are added to `seen`,
    (points, R), and all entries of `seen` are used.
    A row's margin is the largest excess of the exact value over the smoothed one within one step
    of the regular grid: that covers the jumps of dry friction at sign changes. `exact`,
    (points, R), are the exact violations on the fine grid.
    """
    points = len(exact)
    fine = 2 * np.pi * np.arange(points) / points
    reach = max(1, points // phase.points)
    gap = smoothing_gap(
        problem.limits, problem.states(x, fine), exact, phase.width, reach, periodic=True
    )
    peaks = local_worst(exact, periodic=True) & (exact > -phase.near / 3)
    regular = np.zeros(points, dtype=bool)
    regular[:: max(1, points // (2 * phase.points))] = True
    near = (exact > -phase.near) & np.isfinite(exact)
    seen |= peaks
    used = (regular[:, None] & near) | seen
    chosen = np.any(used, axis=1)
    moments, rows = _worst_moments(problem, check, phase.near)
    nearest = np.rint(moments * points / (2 * np.pi)).astype(np.intp) % points
    covered = used | np.roll(used, 1, axis=0) | np.roll(used, -1, axis=0)
    unseen = np.any(rows & ~covered[nearest], axis=1)
    moments, rows, nearest = moments[unseen], rows[unseen], nearest[unseen]
    margins = np.minimum(gap + 2 * GRID_MARGIN, LARGEST_MARGIN)
    return (
        np.concatenate([fine[chosen], moments]),
        np.concatenate([used[chosen], rows]),
        np.concatenate([margins[chosen], margins[nearest]]),
    )


def _worst_moments(problem: DesignProblem, check: Recheck, near: float) -> tuple[Array, Mask]:
    """Return the phases (J,) of the worst moments of a checked motion, and the rows (J, R).

    Only limits closer to their bounds than a share of their range are included.
    """
    limits, omega = problem.limits, problem.variables.omega_bounds[0]
    judged = zip(limits.limits, limits.columns, check.limits, strict=True)
    found = [
        (omega * one.time, columns.start + limit.labels.index(one.row))
        for limit, columns, one in judged
        if -near < one.violation < np.inf
    ]
    rows = np.zeros((len(found), len(limits.keys)), dtype=bool)
    rows[range(len(found)), [column for _, column in found]] = True
    return np.array([phase for phase, _ in found]), rows
