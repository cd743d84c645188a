"""View of a sweep: designs over a grid."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import methodcaller

import numpy as np

from expdesign.configuration import RunConfiguration
from expdesign.configuration.several_runs import short_path, value_text
from expdesign.experiment.judging import criterion_symbol
from expdesign.experiment.sweep import FAILED, SweepResult, SweptDesign
from expdesign.information.criteria import criteria
from results.figures.studies import sweep_figure
from results.notation import count_text, duration, readable
from results.views.folder import RunFolder
from results.views.parameter_blocks import symbols_blocks
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)

_NOTE = "interrupted: designs are missing or not complete"
_READ = (
    "Every design has a run folder: expdesign run FOLDER/run.yaml --out FOLDER continues one, "
    "expdesign compare compares several. σ is the predicted standard deviation of the whole "
    "experiment, from its noise and the robot's tolerances, over the nominal value."
)


def sweep_view(folder: RunFolder) -> StageView:
    """Return the view of the sweep in a folder."""
    result = folder.result(SweepResult)
    blocks: tuple[Block, ...] = (
        TextBlock(_READ),
        Drawing(sweep_figure, result),
        _table(result, "sweep", _CAPTION, _promised(folder.configuration, result)),
        *symbols_blocks((one.worst_parameter for one in result.designs), screen=True),
        _table(result, "sweep_searches", "The searches, and where the designs are", _SEARCHED),
    )
    note = _NOTE if result.interrupted else ""
    verdict, facts = _verdict(result), _facts(result)
    return StageView(verdict, blocks, facts, heading="Designs over a grid", figure_note=note)


_CAPTION = (
    "Designs: median of σ over the parameters for one measuring time of all designs and for their "
    "own experiments, the largest σ and its parameter, measuring time (also for each goal), "
    "processor time of the search, and whether every limit is proved to be kept"
)


def _promised(configuration: RunConfiguration, result: SweepResult) -> tuple[TableColumn, ...]:
    design, title = configuration.run.design, "criterion value"
    if not {path.rpartition(".")[2] for path in result.grid} & _OF_THE_CRITERION:
        title = criteria()[design.criterion].named(criterion_symbol(configuration))
    return (
        TableColumn("status", kind="outcome", of="status"),
        TableColumn(title, digits=5, of="criterion_value"),
        TableColumn("σ, equal time", "%", digits=3, of="equal_time_rel_std_percent"),
        TableColumn("σ, median", "%", digits=3, of="median_rel_std_percent"),
        TableColumn("σ, worst", "%", digits=3, of="worst_rel_std_percent"),
        TableColumn("of", kind="parameter", of="worst_parameter"),
        TableColumn("measuring", "s", of="measuring_time"),
        *(
            TableColumn(f"for {goal}", "min", digits=3, of=methodcaller("minutes", place))
            for place, goal in enumerate(configuration.run.goals)
        ),
        TableColumn("search", "s", digits=3, of="cpu_seconds"),
        TableColumn("proved", of="certified", proof=True),
    )


_OF_THE_CRITERION = {"criterion", "counts", "information", "interest", "systematic", "estimators"}
"""Keys of a grid with which the designs' criteria are different ones."""

_SEARCHED = (
    TableColumn("period", "s", of="period"),
    TableColumn("iterations", of="iterations"),
    TableColumn("evaluations", of="evaluations"),
    TableColumn("folder", kind="text", of="folder"),
    TableColumn("reason", kind="text", of="reason"),
)


def _table(
    result: SweepResult, key: str, caption: str, columns: Iterable[TableColumn]
) -> ReportTable:
    points = {one.number: point for one, point in zip(result.designs, result.points, strict=True)}

    def value_at(path: str) -> Callable[[SweptDesign], str]:
        return lambda one: value_text(points[one.number][path])

    front = (TableColumn(short_path(path), kind="text", of=value_at(path)) for path in result.grid)
    every = (TableColumn("design", of="number"), *front, *columns)
    main = key == "sweep"
    return ReportTable.of(
        key, caption, every, result.designs, folded=not main, screen=main, latex=main
    )


def _verdict(result: SweepResult) -> StageVerdict:
    total, complete = len(result.designs), sum(one.complete for one in result.designs)
    sentence = f"{complete} of {count_text(total, 'design')}"
    wrong = [
        f"{label} ({one.reason if one.status == FAILED else one.status})"
        for label, one in zip(result.labels, result.designs, strict=True)
        if one.wrong
    ]
    sentence += f" over {', '.join(result.grid)}."
    if not result.comparable:
        sentence += (
            " The designs differ in their parameters, priors or other motions: none is the most "
            "precise."
        )
    if wrong:
        sentence += f" Failed: {'; '.join(wrong)}."
    if result.interrupted:
        sentence += " The sweep was interrupted; the same command continues it."
        return StageVerdict("Sweep", Level.BAD, "interrupted", sentence, "sweep")
    level, word = (Level.BAD, "incomplete") if wrong else (Level.GOOD, "complete")
    return StageVerdict("Sweep", level, word, sentence, "sweep")


_LONGER = 1.05
"""Ratio of measuring times from which a comparison of the precision names them."""


def _facts(result: SweepResult) -> tuple[Fact, ...]:
    best = result.most_precise
    spent = sum(one.cpu_seconds for one in result.designs if one.made)
    note = f"processor time of {len(result.designs)} designs"
    searches = Fact("searches", duration(spent), note)
    if best is None:
        return () if result.comparable else (searches,)
    label = dict(zip(result.designs, result.labels, strict=True))[best]
    value = f"{readable(best.precision, 3)} %"
    times = [one.measuring_time for one in result.designs if one.complete]
    equal = np.isfinite(best.equal_time_rel_std_percent)
    when = " for one measuring time of all designs" if equal else ""
    note = f"median predicted σ{when}, with {label}: {best.folder}"
    if not equal and max(times) > _LONGER * min(times):
        note += (
            f". Designs measure for {readable(min(times), 3)} to {readable(max(times), 3)} s: more "
            "time alone makes σ smaller"
        )
    return Fact("most precise design", value, note), searches
