"""Searches of excitation trajectories: one design, and designs over a grid."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from expdesign.configuration import ComputationError, InputError, RunConfiguration, quantity_text
from expdesign.configuration.run import GridPoint
from expdesign.experiment import DesignResult, design
from expdesign.experiment.motions import MotionsResult, design_motions
from expdesign.experiment.next_motion import NextResult, compare_with_repetition
from expdesign.experiment.plan import LONGEST_DAYS, PlanResult, plan_measurement
from expdesign.experiment.sweep import (
    FAILED,
    FOLDER,
    INTERRUPTED,
    NOT_BEGUN,
    SweepResult,
    SweptDesign,
    design_point,
    sweep_result,
)
from expdesign.information.fisher import SingularInformationError
from expdesign.information.identifiable import listed
from expdesign.interruption import interruptible
from expdesign.solver.starts import StartResult
from expdesign.stages.execution import input_hash, is_done, motion_workspaces, origins, save
from expdesign.stages.stage import Outcome, Stage, StageFailed, StageFunctions, Workspace, short
from expdesign.workers import (
    ClusterError,
    Job,
    JobJournal,
    Monitor,
    StoppedError,
    WorkerDiedError,
    run_jobs,
)
from results.comparison.designs import compare_designs
from results.views.design import design_view
from results.views.folder import StageViews
from results.views.motions import motions_view
from results.views.plan import next_view, plan_view
from results.views.sweep import sweep_view

__all__ = ["DesignResult", "design"]
"""Public names of `expdesign`, whose results show themselves with the functions of this module."""

_KEPT = "if a start has a result by now, the best so far is finished and saved"
_CONTINUES = "starts and hops that had ended are kept, and --resume continues"
_DISCARDED = "discarded: nothing of this design is saved"
_SWEEP_KEPT = "finished designs are kept, and of the running ones the best so far"
_MOST_REASONS = 3
Made = TypeVar("Made")
SEARCH_JOURNAL = "search.jsonl"
"""Journal of a search that has not ended."""


def run_design(work: Workspace) -> Outcome:
    """Design; Ctrl-C keeps the best so far, and a lost cluster what had ended."""
    progress = work.progress
    with (
        _journal(work, "design", resume=work.resume) as journal,
        interruptible(progress.note, _KEPT, "discards the design", _DISCARDED) as stop,
    ):
        if work.resume:
            progress.note(f"results of earlier starts and hops: {journal.count}")
        with progress.search(work.configuration) as report:
            monitor = Monitor(stop, report)
            result = name_unexcited(lambda: design(work.configuration, monitor, journal))
        outcome = design_outcome(result, work)
    return replace(outcome, asked_to_stop=stop())


@contextmanager
def _journal(
    work: Workspace,
    stage: str,
    *,
    resume: bool,
    keep: tuple[type[ComputationError], ...] = (ClusterError, WorkerDiedError),
) -> Iterator[JobJournal]:
    """Provide the journal of a search; remove it after a failure other than those of `keep`."""
    path = work.folder / SEARCH_JOURNAL
    journal = JobJournal(path, work.inputs[stage], StartResult, resume=resume)
    try:
        yield journal
    except keep as error:
        more = f"; {_CONTINUES}" if journal.count else ""
        raise type(error)(f"{error.message}{more}") from error
    except (KeyboardInterrupt, ComputationError, StageFailed):
        path.unlink(missing_ok=True)
        raise


def design_outcome(result: DesignResult, work: Workspace) -> Outcome:
    """Return the outcome of a design."""
    return Outcome(
        result=result,
        summary={
            "design_status": result.status,
            "log_det_information": result.log_det_information,
            "criterion": result.configuration.run.design.criterion,
            "criterion_value": result.criterion_value,
            "worst_violation": result.check.worst,
            "warnings": list(result.warnings),
        },
        status="done" if result.passed else result.status,
        message=result.status_text,
        warnings=result.warnings[len(work.configuration.warnings) :],
        failure="" if result.passed else _failure(result, short(work.folder)),
        temporary=() if result.status == "interrupted" else (work.folder / SEARCH_JOURNAL,),
    )


def run_motions(stage: Stage, work: Workspace) -> Outcome:
    """Design several motions, each with a run folder; Ctrl-C ends the exchanges with the best."""
    progress, configuration, began = work.progress, work.configuration, time.perf_counter()
    keep = (ClusterError, WorkerDiedError, StoppedError)
    with (
        _journal(work, "motions", resume=work.resume, keep=keep) as journal,
        interruptible(progress.note, _KEPT, "discards the motions", _DISCARDED) as stop,
    ):

        @contextmanager
        def searching(run: RunConfiguration) -> Iterator[Monitor]:
            progress.note(f"a search of {run.run.name}")
            with progress.search(run) as report:
                yield Monitor(stop, report)

        result, designs = name_unexcited(
            lambda: design_motions(configuration, work.folder, searching, journal)
        )
        # Each motion is an input of the others: all are written before one is complete.
        places = motion_workspaces(work)
        written = [one.write(place.folder) for one, place in zip(designs, places, strict=True)]
        files, failures = result.write(work.folder), list[str]()
        for one, place, own in zip(designs, places, written, strict=True):
            place.inputs[stage.name] = input_hash(stage, place)
            place.origins[stage.name] = origins(stage, place)
            outcome = replace(design_outcome(one, place), files=tuple(own))
            save(outcome, stage, place, began)
            files.append(place.folder / DesignResult.FILE)
            failures += [outcome.failure] if outcome.failure else []
    broken = [one.status for one in designs if not one.passed]
    if result.interrupted and not broken:
        broken = ["interrupted"]
        failures = [f"interrupted: the best so far is saved in {short(work.folder)}; {_CONTINUES}"]
    return Outcome(
        result=result,
        files=tuple(files),
        summary={
            "criterion": result.criterion,
            "criterion_value": result.criterion_value,
            "log_det_information": result.log_det_information,
            "measuring_time": result.measuring_time,
            "motions": [asdict(one) for one in result.motions],
            "warnings": list(result.warnings),
        },
        status=broken[0] if broken else "done",
        message=result.ended,
        warnings=result.warnings[len(configuration.warnings) :],
        failure="; ".join(failures),
        temporary=() if "interrupted" in broken else (work.folder / SEARCH_JOURNAL,),
        asked_to_stop=stop(),
    )


def run_goals(work: Workspace) -> Outcome:
    """Plan the measuring time; a goal that is not reachable is a failure."""
    design = work.design()
    warnings = work.warn_of(design)
    result = plan_measurement(work.configuration, design.trajectory)
    missed = [one.goal for one in result.goals if not one.reachable]
    return Outcome(
        result=result,
        summary={
            "reachable": result.reachable,
            "periods": result.periods,
            "minutes": result.minutes,
            "goals": [asdict(one) for one in result.goals],
        },
        # Not "done": a run would keep the plan, and go on to the stages after it.
        status="not reachable" if missed else "done",
        warnings=tuple(warnings),
        failure=f"{LONGEST_DAYS} days of measuring do not reach {listed(missed)}; change the "
        "goals or the tolerances as proposed, or run without `goals`"
        if missed
        else "",
    )


def run_next(work: Workspace) -> Outcome:
    """Compare the design made before with the motion to repeat, which the options name."""
    following = work.made["design"].result.trajectory
    result = compare_with_repetition(work.configuration, following, work.design().trajectory)
    return Outcome(
        result=result,
        summary={
            "repeated_percent": result.repeated_percent,
            "next_percent": result.next_percent,
            "gains": [asdict(one) for one in result.gains],
        },
    )


def name_unexcited(make: Callable[[], Made]) -> Made:
    """Make a design; a singular information is a failure that names the parameters and a remedy."""
    try:
        return make()
    except SingularInformationError as error:
        shown = f" Identifiable are {listed(error.shows)}." if error.shows else ""
        remedy = (
            "Design for the identifiable ones (design.parameters: base)"
            if error.structural
            else "Widen speed, acceleration or workspace"
        )
        raise StageFailed(
            f"no motion within the limits excites these parameters: {error.combinations}.{shown} "
            f"{remedy}, or leave {', '.join(error.unexcited)} out of design.parameters.",
            error.details,
        ) from error


def _failure(result: DesignResult, folder: str) -> str:
    if result.status == "interrupted":
        return (
            f"interrupted: the best so far is saved and marked in {folder} ({result.status_text}); "
            f"{_CONTINUES}"
        )
    broken = [check for check in result.check.limits if not check.kept]
    parts = []
    for check in sorted(broken, key=lambda check: -check.violation):
        row = f"{check.row}: " if check.row else ""
        parts.append(
            f"{check.key} ({row}{quantity_text(check.value, check.unit)} at {check.time:.4g} s, "
            f"bound {quantity_text(check.bound, check.unit)}: {100 * check.violation:.2g} % of its "
            "range)"
        )
    return f"the design breaks {'; '.join(parts)}. It is saved and marked in {folder}"


def run_sweep(stage: Stage, work: Workspace) -> Outcome:
    """Design every point that is not done; a failed design does not end the others."""
    progress, configuration = work.progress, work.configuration
    with (
        progress.count("designs") as advanced,
        interruptible(progress.note, _SWEEP_KEPT, "discards the running ones") as stop,
    ):
        designs = list(_designs(stage, work, Monitor(stop, advanced=advanced)))
        if stop() and not any(one.made for one in designs):
            raise StoppedError("interrupted before the first design was done")
        result = sweep_result(configuration, designs)
        files = result.write(work.folder)
    files += [work.folder / one.folder / DesignResult.FILE for one in designs if one.made]
    status, message = _end(result)
    place = f"The finished designs are in {short(work.folder)}"
    place += ", and the same command continues the sweep" if result.interrupted else ""
    return Outcome(
        result=result,
        files=tuple(files),
        summary={
            "designs": len(designs),
            "made": result.made,
            "failed": sum(one.wrong for one in designs),
            "interrupted": result.interrupted,
            "points": [
                {"values": dict(point.values), "folder": one.folder, "status": one.status}
                for point, one in zip(configuration.grid, designs, strict=True)
            ],
            "warnings": list(configuration.warnings),
        },
        status=status,
        message=message,
        failure="" if status == "done" else f"{message}. {place}",
        continues=status == "incomplete",
        asked_to_stop=stop(),
    )


def _designs(stage: Stage, work: Workspace, monitor: Monitor) -> Iterator[SweptDesign]:
    """Yield the designs in the order of the grid; finished ones are read from their folders."""
    points = work.configuration.grid
    seconds = min(
        run.experiment.periods / run.trajectory.frequency[1]
        for run in (point.configuration.run for point in points)
    )
    places = [_workspace(stage, point, work.folder) for point in points]
    kept = [is_done(stage, place) for place in places]
    missing = [point for point, done in zip(points, kept, strict=True) if not done]
    jobs = [Job(_make_design, (stage, point, work.folder)) for point in missing]
    workers = work.configuration.run.workers or 1
    # The jobs have nothing in common.
    made = run_jobs(object, jobs, workers, Monitor(monitor.stop_requested))
    for number, (point, place, done) in enumerate(zip(points, places, kept, strict=True), start=1):
        end = _End("", "") if done else next(made, _End(NOT_BEGUN, "the sweep was interrupted"))
        if end.without:
            yield SweptDesign.missing(number, point, end.without, end.reason)
        else:
            result = DesignResult.read(place.folder)
            yield SweptDesign.of(number, point, result, end.reason, seconds)
        monitor.advanced(number, len(points))


def _workspace(stage: Stage, point: GridPoint, folder: Path) -> Workspace:
    """Return the workspace of the design of a point, with the hash of its inputs."""
    work = Workspace(point.configuration, folder / FOLDER / point.name)
    work.inputs[stage.name] = input_hash(stage, work)
    return work


class _End(NamedTuple):
    """End of the job of a design."""

    without: str
    """Status of a point without a design; empty with one."""
    reason: str


def _make_design(
    _built: object, monitor: Monitor, stage: Stage, point: GridPoint, folder: Path
) -> _End:
    """Make the design of a point and its run folder, in the process of the job."""
    work, began = _workspace(stage, point, folder), time.perf_counter()
    try:
        with _journal(work, stage.name, resume=True) as journal:
            result = name_unexcited(lambda: design_point(point.configuration, monitor, journal))
    except (StoppedError, ClusterError) as error:
        return _End(INTERRUPTED, error.message)
    except ComputationError as error:
        return _End(FAILED, error.message)
    except InputError as error:
        return _End(FAILED, "; ".join(problem.message for problem in error.problems))
    outcome = design_outcome(result, work)
    save(outcome, stage, work, began)
    return _End("", outcome.failure)


def _end(result: SweepResult) -> tuple[str, str]:
    """Return the status of a sweep for the manifest, and one line about it."""
    total, failed = result.point_count, sum(one.wrong for one in result.designs)
    complete = sum(one.complete for one in result.designs)
    if not (failed or result.interrupted):
        return "done", f"{total} designs"
    reasons = [
        f"{label}: {one.reason}"
        for label, one in zip(result.labels, result.designs, strict=True)
        if (one.status == INTERRUPTED if result.interrupted else one.wrong)
    ]
    more = "; …" if len(reasons) > _MOST_REASONS else ""
    listed_reasons = f": {'; '.join(reasons[:_MOST_REASONS])}{more}" if reasons else ""
    if result.interrupted:
        message = f"interrupted after {complete} of {total} designs{listed_reasons}"
        return "interrupted", message
    return "incomplete", f"{failed} of {total} designs failed{listed_reasons}"


def stage_functions(stage: Stage) -> dict[str, StageFunctions]:
    """Return the functions of the stages by name; `stage` is that of the single designs."""
    return {
        **_FUNCTIONS,
        "motions": StageFunctions(
            partial(run_motions, stage), StageViews(MotionsResult, motions_view)
        ),
        "sweep": StageFunctions(partial(run_sweep, stage), StageViews(SweepResult, sweep_view)),
    }


_FUNCTIONS = {
    "design": StageFunctions(run_design, StageViews(DesignResult, design_view, compare_designs)),
    "next": StageFunctions(run_next, StageViews(NextResult, next_view)),
    "goals": StageFunctions(run_goals, StageViews(PlanResult, plan_view)),
}
