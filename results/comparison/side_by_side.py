"""Stages side by side: the facts of any stage, and the precision of Monte-Carlo studies."""

from __future__ import annotations

from collections.abc import Mapping

from estimation.montecarlo.result import MonteCarloResult
from results.notation import counted
from results.views.estimate import NAMES
from results.views.folder import RunFolder
from results.views.view import Level, ReportTable, StageVerdict, StageView, TableColumn


def compare_facts(stage: str, folders: Mapping[str, RunFolder]) -> StageView | None:
    """Return verdicts and facts of a stage's views, one column per folder; None without facts."""
    views = {
        label: folder.stages[stage].view(folder, brief=True) for label, folder in folders.items()
    }
    facts = {label: {fact.name: fact.value for fact in view.facts} for label, view in views.items()}
    names = dict.fromkeys(name for own in facts.values() for name in own)
    if not names:
        return None
    rows = [
        ("verdict", *(view.verdict.word for view in views.values())),
        *((name, *(own.get(name) for own in facts.values())) for name in names),
    ]
    columns = [TableColumn(title, kind="text") for title in ("", *views)]
    title = next(iter(views.values())).verdict.title
    table = ReportTable.of(
        f"compared_{stage}", f"{title}: verdicts and main numbers", columns, rows
    )
    sentence = f"{counted(len(views), 'folder')}: verdicts and main numbers."
    verdict = StageVerdict(title, Level.NEUTRAL, "compared", sentence, f"compared_{stage}")
    return StageView(verdict, (table,))


def compare_montecarlo(folders: Mapping[str, RunFolder]) -> StageView:
    """Return the achieved standard deviations of Monte-Carlo studies."""
    found = {label: folder.result(MonteCarloResult).rows for label, folder in folders.items()}
    keys = dict.fromkeys((row.parameter, row.unit) for rows in found.values() for row in rows)
    columns = [
        TableColumn("parameter", kind="parameter", of=[parameter for parameter, _ in keys]),
        TableColumn("unit", kind="text", of=[unit for _, unit in keys]),
    ]
    for label, rows in found.items():
        bounds = {(row.parameter, row.unit): row.bound for row in rows}
        columns.append(
            TableColumn(f"bound, {label}", digits=3, of=[bounds.get(key) for key in keys])
        )
        for estimator in dict.fromkeys(row.estimator for row in rows):
            own = [row for row in rows if row.estimator == estimator]
            spread = {(row.parameter, row.unit): row.spread for row in own}
            title = f"{NAMES.get(estimator, estimator)}, {label}"
            columns.append(TableColumn(title, digits=3, of=[spread.get(key) for key in keys]))
    caption = (
        "Standard deviations that the estimators achieved in simulated experiments, and the "
        "Cramér–Rao bound of each, SI units"
    )
    table = ReportTable.of("achieved", caption, columns)
    number = counted(len(folders), "study", "studies")
    sentence = f"{number}: achieved standard deviations and the bound."
    title = "Monte-Carlo studies"
    return StageView(StageVerdict(title, Level.NEUTRAL, "compared", sentence, "studies"), (table,))
