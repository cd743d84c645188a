"""The stage that makes a design for every point of a grid."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from expdesign.configuration import ComputationError
from expdesign.configuration.run import GridPoint
from expdesign.experiment import DesignResult
from expdesign.experiment.sweep import (
    FAILED,
    INTERRUPTED,
    NOT_BEGUN,
    SweepResult,
    SweptDesign,
    design_folder,
    design_point,
    sweep_result,
)
from expdesign.interruption import interruptible
from expdesign.stages.design import outcome_of, searched
from expdesign.stages.outcome import Outcome, short
from expdesign.stages.record import is_done, stage_inputs
from expdesign.stages.run import saved
from expdesign.stages.table import FIRST
from expdesign.stages.workspace import Workspace
from expdesign.workers import Job, Monitor, StoppedError, run_jobs

_KEPT = "designs that are done are kept, and of those under way the best so far"
_MOST_REASONS = 3


def perform(work: Workspace) -> Outcome:
    """Design every point that is not done; one that fails does not end the others."""
    progress, configuration = work.progress, work.configuration
    with (
        progress.count("designs") as advanced,
        interruptible(progress.note, _KEPT, "abandons those under way") as stop,
    ):
        designs = list(_designs(work, Monitor(stop, advanced=advanced)))
        if stop() and not any(one.made for one in designs):
            raise StoppedError("interrupted before the first design was done")
        record = sweep_result(configuration, designs)
        files = [*record.write(work.folder), *_drawn(record, work)]
    files += [work.folder / one.folder / DesignResult.FILE for one in designs if one.made]
    status, message = _end(record)
    return Outcome(
        result=record,
        record=record,
        files=tuple(files),
        summary={
            "designs": len(designs),
            "made": record.made,
            "failed": sum(one.wrong for one in designs),
            "interrupted": record.interrupted,
            "points": [
                {"values": dict(point.values), "folder": one.folder, "status": one.status}
                for point, one in zip(configuration.grid, designs, strict=True)
            ],
            "warnings": list(configuration.warnings),
        },
        status=status,
        message=message,
        failure="" if status == "done" else f"{message}. {_how_to_go_on(record, work.folder)}",
        goes_on=status == "incomplete",
        asked_to_stop=stop(),
    )


def _designs(work: Workspace, monitor: Monitor) -> Iterator[SweptDesign]:
    """Yield the designs in the order of the grid; what is done already is read from its folder."""
    points = work.configuration.grid
    places = [_workspace(point, work.folder) for point in points]
    kept = [is_done(FIRST, place) for place in places]
    jobs = [Job(_designed, (p, work.folder)) for p, k in zip(points, kept, strict=True) if not k]
    workers = work.configuration.run.workers or 1
    made = run_jobs(_nothing, jobs, workers, Monitor(monitor.stop_requested))
    for number, (point, place, done) in enumerate(zip(points, places, kept, strict=True), start=1):
        end = _End("", "") if done else next(made, _End(NOT_BEGUN, "the sweep was interrupted"))
        if end.without:
            yield SweptDesign.missing(number, point, end.without, end.reason)
        else:
            yield SweptDesign.of(number, point, DesignResult.read(place.folder), end.reason)
        monitor.advanced(number, len(points))


def _workspace(point: GridPoint, folder: Path) -> Workspace:
    """Return what makes the design of a point, with the hash of what it is made from."""
    work = Workspace(point.configuration, design_folder(folder, point.name))
    work.inputs[FIRST] = stage_inputs(FIRST, work)
    return work


def _nothing() -> None:
    """Build what all jobs have in common."""


class _End(NamedTuple):
    """How the job of a design ended."""

    without: str
    """The status of a point that has no design; empty where there is one."""
    reason: str


def _designed(_built: None, monitor: Monitor, point: GridPoint, folder: Path) -> _End:
    """Make the design of a point and its run folder, in the process of the job."""
    work, began = _workspace(point, folder), time.perf_counter()
    try:
        result = searched(lambda: design_point(point.configuration, monitor))
    except StoppedError as error:
        return _End(INTERRUPTED, error.message)
    except ComputationError as error:
        return _End(FAILED, error.message)
    outcome = outcome_of(result, work)
    saved(outcome, FIRST, work, began)
    return _End("", outcome.failure)


def _drawn(record: SweepResult, work: Workspace) -> tuple[Path, ...]:
    # The library that draws takes a second to load.
    from results import record_figures

    return record_figures(record, work.folder, work.configuration.run.report.figures)


def _end(record: SweepResult) -> tuple[str, str]:
    """Return how a sweep ended, as the manifest has it, and one line about it."""
    total, failed = record.point_count, sum(one.wrong for one in record.designs)
    complete = sum(one.complete for one in record.designs)
    if record.interrupted:
        return "interrupted", f"interrupted after {complete} of {total} designs"
    if not failed:
        return "done", f"{total} designs"
    reasons = [
        f"{label}: {one.reason}"
        for label, one in zip(record.labels, record.designs, strict=True)
        if one.wrong
    ]
    more = "; …" if len(reasons) > _MOST_REASONS else ""
    return (
        "incomplete",
        f"{failed} of {total} designs failed: {'; '.join(reasons[:_MOST_REASONS])}{more}",
    )


def _how_to_go_on(record: SweepResult, folder: Path) -> str:
    what = f"What there is stands in {short(folder)}"
    return f"{what}, and the same command goes on from there" if record.interrupted else what
