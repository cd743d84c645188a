"""Designs of a sweep, each in its own run folder and by a worker process."""

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
from expdesign.stages.design import DesignStage, design_outcome, name_unexcited
from expdesign.stages.execution import input_hash, is_done, save
from expdesign.stages.workspace import Outcome, Workspace, short
from expdesign.workers import Job, Monitor, StoppedError, run_jobs

_DESIGN = DesignStage()
_MOST_REASONS = 3


def make_sweep(work: Workspace, monitor: Monitor) -> Outcome:
    """Design every point that is not done, and write the result."""
    configuration, stop = work.configuration, monitor.stop_requested
    designs = list(_designs(work, monitor))
    if stop() and not any(one.made for one in designs):
        raise StoppedError("interrupted before the first design was done")
    result = sweep_result(configuration, designs)
    files = result.write(work.folder)
    files += [work.folder / one.folder / DesignResult.FILE for one in designs if one.made]
    status, message = _end(result)
    return Outcome(
        result=result,
        record=result,
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
        failure="" if status == "done" else f"{message}. {_continuation(result, work.folder)}",
        continues=status == "incomplete",
        asked_to_stop=stop(),
    )


def _designs(work: Workspace, monitor: Monitor) -> Iterator[SweptDesign]:
    """Yield the designs in the order of the grid; finished ones are read from their folders."""
    points = work.configuration.grid
    places = [_workspace(point, work.folder) for point in points]
    kept = [is_done(_DESIGN, place) for place in places]
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
    """Return the workspace of the design of a point, with the hash of its inputs."""
    work = Workspace(point.configuration, design_folder(folder, point.name))
    work.inputs[_DESIGN.name] = input_hash(_DESIGN, work)
    return work


def _nothing() -> None:
    """Build nothing: the jobs have nothing in common."""


class _End(NamedTuple):
    """End of the job of a design."""

    without: str
    """Status of a point without a design; empty with one."""
    reason: str


def _designed(_built: None, monitor: Monitor, point: GridPoint, folder: Path) -> _End:
    """Make the design of a point and its run folder, in the process of the job."""
    work, began = _workspace(point, folder), time.perf_counter()
    try:
        result = name_unexcited(lambda: design_point(point.configuration, monitor))
    except StoppedError as error:
        return _End(INTERRUPTED, error.message)
    except ComputationError as error:
        return _End(FAILED, error.message)
    outcome = design_outcome(result, work)
    save(outcome, _DESIGN, work, began)
    return _End("", outcome.failure)


def _end(record: SweepResult) -> tuple[str, str]:
    """Return the status of a sweep for the manifest, and one line about it."""
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


def _continuation(result: SweepResult, folder: Path) -> str:
    place = f"The finished designs are in {short(folder)}"
    return f"{place}, and the same command continues the sweep" if result.interrupted else place
