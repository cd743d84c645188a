"""Statistics of a search: its starts and hops, the iterations of each, the work of them all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from expdesign.information.criteria import criteria
from expdesign.runfolder import JSON_ONLY, OpenNumber, described
from expdesign.solver.jobs import StartResult, status_text
from expdesign.solver.search import SearchResult


@dataclass(frozen=True)
class StartSummary:
    """A start or hop of the search; the table has no times, and is the same for the same seed."""

    index: Annotated[
        int, described("1", "number of the start, from 1; hops go on counting", name="start")
    ]
    kind: Annotated[str, described("", "random, or hop")]
    criterion_value: Annotated[
        OpenNumber,
        described(
            "", "criterion of the motion reached, shrunk into its limits at a few hundred points"
        ),
    ]
    finished_value: Annotated[
        OpenNumber, described("", "the same after its finish; empty for those not finished")
    ]
    iterations: Annotated[int, described("1", "iterations of all stages")]
    converged: Annotated[bool, described("", "whether the last stage converged")]
    status: Annotated[str, described("", "how the last stage ended")]
    best: Annotated[
        bool, described("", "whether the design came from it: the best of the finished")
    ]
    seconds: Annotated[float, JSON_ONLY, described("s", "time that it took")]
    stages: Annotated[
        tuple[dict[str, Any], ...], JSON_ONLY, described("", "settings and work of each stage")
    ]


@dataclass(frozen=True)
class Iteration:
    """An iteration of the optimiser."""

    start: Annotated[int, described("1", "number of the start")]
    kind: Annotated[str, described("", "random or hop")]
    stage: Annotated[str, described("", "blunt: rough search, sharp: refinement, hop, finish")]
    iteration: Annotated[int, described("1", "iteration, counted over the stages")]
    objective: Annotated[OpenNumber, described("", "smoothed criterion, as it is reported")]
    violation: Annotated[
        OpenNumber, described("1", "largest violation in the NLP, share of the limit's range")
    ]


@dataclass(frozen=True)
class SearchStatistics:
    """Work and end of a search."""

    name: Annotated[str, described("", "the methods of the solver")]
    iterations: Annotated[int, described("1", "iterations of all starts and of the finish")]
    evaluations: Annotated[dict[str, int], described("1", "evaluations by function")]
    seconds: Annotated[float, described("s", "time of the search")]
    best_start: Annotated[int, described("1", "number of the best start")]
    finish: Annotated[
        dict[str, Any], described("", "factor `shrink` and `record` of the finish of the best")
    ]
    starts: Annotated[tuple[StartSummary, ...], described("", "the starts and hops")]
    ended: Annotated[str, described("", "reason for the end of the search")]
    cpu_seconds: Annotated[
        OpenNumber, described("s", "processor time, without building the problem")
    ]


def search_statistics(search: SearchResult, criterion: str) -> SearchStatistics:
    """Return the statistics of a search.

    Parameters
    ----------
    search : SearchResult
    criterion : str
        Key of the criterion, whose values are stated in its own sign.
    """
    finish = search.polished.phase
    phases = [phase for start in search.starts for phase in start.phases]
    phases += [] if finish is None else [finish]
    evaluations: Counter[str] = Counter()
    for phase in phases:
        evaluations.update(phase.evaluations)
    sign = 1 if criteria()[criterion].larger_is_better else -1
    return SearchStatistics(
        name="dense interior point, then Ipopt through CasADi",
        iterations=sum(phase.iterations for phase in phases),
        evaluations=dict(evaluations),
        seconds=search.seconds,
        cpu_seconds=search.cpu_seconds,
        best_start=search.best.index,
        finish={
            "shrink": search.polished.shrink,
            "record": None if finish is None else asdict(finish),
        },
        starts=tuple(_summary(start, search, sign) for start in search.starts),
        ended=search.ended,
    )


def _summary(start: StartResult, search: SearchResult, sign: int) -> StartSummary:
    return StartSummary(
        index=start.index,
        kind=start.kind,
        criterion_value=sign * start.merit if start.usable else np.nan,
        finished_value=sign * search.merits.get(start.index, np.nan),
        iterations=start.iterations,
        converged=start.converged,
        status=start.status,
        best=start.index == search.best.index,
        seconds=start.seconds,
        stages=tuple(asdict(phase) for phase in start.phases),
    )


def search_iterations(search: SearchResult) -> Iterator[Iteration]:
    """Yield the iterations of every start; those of the finish follow the ones of its start."""
    for start in search.starts:
        finish = search.polished.trace if start is search.best else ()
        further = (replace(p, iteration=start.iterations + p.iteration) for p in finish)
        for point in (*start.trace, *further):
            yield Iteration(
                start=start.index,
                kind=start.kind,
                stage=point.phase,
                iteration=point.iteration,
                objective=point.objective,
                violation=point.violation,
            )


def search_status(search: SearchResult) -> tuple[str, str]:
    """Return the status of a design and how its start and finish ended, in words.

    The status is ``"limits broken"``, ``"interrupted"``, ``"converged"`` or ``"not converged"``.
    """
    finish = search.polished.phase
    end = "not solved again" if finish is None else status_text(finish.status)
    text = f"start: {search.best.status}; finish: {end}"
    if not search.polished.check.passed:
        return "limits broken", text
    if search.interrupted:
        return "interrupted", text
    converged = search.best.converged and (finish is None or finish.converged)
    return "converged" if converged else "not converged", text
