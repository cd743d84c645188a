"""One page with the claims, figures and tables of the studies, and their files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path

import pandas as pd

from examples.paper.figures import FIGURES
from examples.paper.setting import Setting, StudyResult
from results.figures.drawing import save_figures

SIMULATED = (
    "All numbers come from the digital twin: they are simulated. The paper's values are of a real "
    "machine whose geometry and noise are not public; only the pattern can be compared."
)
ANOTHER_ROBOT = (
    "Comparisons with numbers that the paper prints apply to its own robot, PaLiDA, and are left "
    "out."
)
_LONGEST = 60
"""Rows of a table that the page shows; the CSV file has all."""

_STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; font-size: 13px; }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .6rem; text-align: left; }
figure { margin: 1.5rem 0; } svg { max-width: 100%; height: auto; }
figcaption, .note { color: #555; }
"""


def write_report(setting: Setting, results: Sequence[StudyResult], out: Path) -> Path:
    """Write report.html, ``tables/*.csv`` and ``figures/*.svg`` and ``.png``; return the page."""
    (out / "tables").mkdir(parents=True, exist_ok=True)
    claims = claims_table(results)
    claims.to_csv(out / "tables" / "claims.csv", index=False)
    body = [
        f"<h1>The paper's studies with {escape(Path(setting.robot).stem)}</h1>",
        f"<p><b>{summary(results)}</b></p><p class=note>{SIMULATED}</p>",
    ]
    if not setting.is_paper_robot:
        body.append(f"<p class=note>{ANOTHER_ROBOT}</p>")
    body.append(claims.to_html(index=False))
    for result in results:
        body.append(f"<h2>{escape(result.title)}</h2>")
        body += _figures(result, out / "figures")
        body += _tables(result, out / "tables")
    page = out / "report.html"
    page.write_text(
        f"<!doctype html><meta charset=utf-8><title>The paper's studies</title><style>{_STYLE}"
        f"</style>{''.join(body)}",
        encoding="utf-8",
    )
    return page


def claims_table(results: Iterable[StudyResult]) -> pd.DataFrame:
    """Return the claims of all studies as they are shown."""
    verdicts = {None: "", True: "holds", False: "fails"}
    return pd.DataFrame(
        {
            "study": result.title,
            "claim": claim.statement,
            "found (simulated)": claim.value,
            "the paper": claim.paper,
            "verdict": verdicts[claim.holds],
        }
        for result in results
        for claim in result.claims
    )


def summary(results: Iterable[StudyResult]) -> str:
    """Return the number of claims that hold, and the statements of those that do not."""
    judged = [claim for result in results for claim in result.claims if claim.holds is not None]
    broken = [claim.statement for claim in judged if not claim.holds]
    text = f"{len(judged) - len(broken)} of {len(judged)} claims hold"
    return text if not broken else f"{text}; not: {'; '.join(broken)}"


def _figures(result: StudyResult, folder: Path) -> Iterator[str]:
    """Save the figures of the tables and of the study itself; yield them for the page."""
    drawn = [(FIGURES[name], table) for name, table in result.tables.items() if name in FIGURES]
    for definition, data in (*drawn, *result.figures):
        paths = save_figures((definition,), data, folder)
        (svg,) = (path for path in paths if path.suffix == ".svg")
        text = svg.read_text(encoding="utf-8")
        caption = f"<figcaption>{escape(definition.caption)}</figcaption>"
        yield f"<figure>{text[text.index('<svg') :]}{caption}</figure>"


def _tables(result: StudyResult, folder: Path) -> Iterator[str]:
    """Write the tables as CSV; yield their first rows for the page."""
    for name, table in result.tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
        html = table.head(_LONGEST).to_html(index=False, float_format="{:.4g}".format, na_rep="")
        rest = "" if len(table) <= _LONGEST else f", first {_LONGEST} of {len(table)} rows"
        yield f"<details><summary>tables/{name}.csv{rest}</summary>{html}</details>"
