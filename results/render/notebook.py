"""Results in Python and notebooks: a few lines of text or HTML, tables and figures by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import lazy_loader
from markupsafe import Markup, escape

from expdesign.runfolder import StageResult
from results.notation import concise
from results.views.folder import RunFolder, StageViews
from results.views.view import Drawing, Fact, Facts, ReportTable, StageView

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
else:
    pd = lazy_loader.load("pandas")

_MOST_FACTS = 10


def show_results(views: StageViews) -> None:
    """Give the results of a stage a short text, an HTML text, and the property ``view``."""
    if not issubclass(views.result_type, StageResult):
        return
    shown: dict[str, Any] = {
        "view": property(lambda result: ResultView(result, views)),
        "__repr__": _short_text,
        "_repr_html_": lambda result: result.view._repr_html_(),
    }
    for name, value in shown.items():
        setattr(views.result_type, name, value)


def _short_text(result: Any) -> str:
    try:
        return repr(result.view)
    except AttributeError:  # a view that needs the run's configuration, which a sweep has not
        return object.__repr__(result)


class ResultView:
    """Content of a result: its verdict and numbers, `tables` and `figures` by name."""

    def __init__(self, result: Any, views: StageViews) -> None:
        self._result, self._views = result, views

    @cached_property
    def _content(self) -> StageView:
        """The view of the result alone: no folder, no other stages."""
        # Views read the configuration of a result without one in its folder only.
        configuration: Any = getattr(self._result, "configuration", None)
        results = {type(self._result): self._result}
        return self._views.view(RunFolder(Path(), {}, configuration, results=results, brief=True))

    @property
    def facts(self) -> tuple[Fact, ...]:
        """The most important numbers, ten at most: name, value with its unit, note."""
        blocks = self._content.blocks
        tables = [block for block in blocks if isinstance(block, ReportTable) and block.screen]
        estimated = [table for table in tables if "error" in [one.kind for one in table.columns]]
        facts = [*self._content.facts, *(_values(estimated[0]) if estimated else ())]
        for block in blocks:
            facts += block.facts if isinstance(block, Facts) else ()
        return tuple(facts[:_MOST_FACTS])

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the stage."""
        return self._content.warnings

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """The tables of the run folder as data frames, by the names of their files; SI units."""
        with TemporaryDirectory() as folder:
            self._result.write(Path(folder))
            files = sorted(Path(folder).rglob("*.csv"))
            return {file.stem: pd.read_csv(file) for file in files}

    @property
    def figures(self) -> Figures:
        """The figures of the report, drawn on access."""
        return Figures(self._content.drawings)

    def __repr__(self) -> str:
        verdict = self._content.verdict
        lines = [f"{verdict.title}: {verdict.word}. {verdict.sentence}"]
        for fact in self.facts:
            note = f" ({fact.note})" if fact.note else ""
            lines.append(f"  {fact.name}: {fact.value}{note}")
        if count := len(self.warnings):
            lines.append(f"  warnings: {count}, see .view.warnings")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        verdict = self._content.verdict
        head = Markup("<p><b>{}: {}.</b> {}</p>").format(
            verdict.title, verdict.word, verdict.sentence
        )
        rows = Markup().join(
            Markup("<tr><th>{}</th><td>{}</td><td>{}</td></tr>").format(f.name, f.value, f.note)
            for f in self.facts
        )
        warnings = Markup().join(
            Markup("<p>warning: {}</p>").format(text) for text in self.warnings
        )
        names = Markup("<p>view.figures: {}</p>").format(", ".join(self.figures) or "none")
        return str(head + Markup("<table>{}</table>").format(rows) + warnings + names)


def _values(table: ReportTable) -> Iterator[Fact]:
    """Yield the rows of a table: name, value with its standard deviation, unit."""
    error = next(k for k, column in enumerate(table.columns) if column.kind == "error")
    titles = [column.title for column in table.columns]
    for row in table.rows:
        unit = row[titles.index("unit")] if "unit" in titles else ""
        yield Fact(f"{row[0]}", f"{concise(row[error - 1], row[error])} {unit or ''}".rstrip())


class Figures(Mapping[str, "Figure"]):
    """Figures of a result by name; each is a Matplotlib figure, drawn on access."""

    def __init__(self, drawings: tuple[Drawing, ...]) -> None:
        self._drawings = {drawing.definition.key: drawing for drawing in drawings}

    def __getitem__(self, name: str) -> Figure:
        drawing = self._drawings[name]
        return drawing.definition.draw(drawing.source)

    def __iter__(self) -> Iterator[str]:
        return iter(self._drawings)

    def __len__(self) -> int:
        return len(self._drawings)

    def __repr__(self) -> str:
        return "\n".join(f"{name}: {one.caption}" for name, one in self._drawings.items())

    def _repr_html_(self) -> str:
        return str(
            Markup().join(
                Markup("<p><b>{}</b>: {}</p>").format(name, escape(one.caption))
                for name, one in self._drawings.items()
            )
        )
