"""What the results of several stages are printed with: tables, findings, numbers with errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import floor, isnan, log10
from typing import TYPE_CHECKING

from rich.table import Table

from expdesign.cli.output import say
from expdesign.stages.outcome import Outcome, short

if TYPE_CHECKING:
    from estimation.diagnostics.finding import DiagnosisVerdict, Finding
    from estimation.identification.term_selection import Selection


def printed_place(outcome: Outcome) -> None:
    """Print where a result is."""
    say(f"written to {short(outcome.folder)}")


def result_table(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Sequence[str],
    *,
    no_wrap: bool = False,
) -> Table:
    """Return a table whose columns are flush right but for those that are named."""
    made = Table(title=title, title_justify="left")
    for head in heads:
        made.add_column(head, justify="left" if head in left else "right", no_wrap=no_wrap)
    for row in rows:
        made.add_row(*row)
    return made


def printed_verdict(verdict: DiagnosisVerdict, begin: str = "") -> None:
    """Print a verdict, and below it what was found against the model: once, with what to do."""
    words, serious = verdict.summary, [each for each in verdict.failed if each.serious]
    if serious:
        count = "1 finding speaks" if len(serious) == 1 else f"{len(serious)} findings speak"
        words = f"{verdict.status.value}: {count} against the model"
    say(f"{begin}{words}")
    printed_findings(verdict.failed)


def printed_findings(findings: Iterable[Finding], *, outcomes: bool = False) -> None:
    """Print findings, a line each; with `outcomes` also what each is about and how it ended."""
    for finding in findings:
        outcome = f"{finding.assumption}: {finding.outcome.value}. " if outcomes else ""
        if outcomes and finding.failed:
            # That an assumption which denies something fails would have to be decoded.
            outcome = f"{finding.contradiction}. "
        advice = f". What to do: {finding.advice}" if finding.advice else ""
        say(f"- {outcome}{finding.sentence}{advice}")


def concise(value: float, std: float) -> str:
    """Return 1.2345(67) for 1.2345 ± 0.0067."""
    if isnan(std):
        return f"{value:.5g} fixed"
    if not std > 0:
        return f"{value:.6g}"
    digits = 1 - floor(log10(std))
    if digits <= 0:
        return f"{value:.0f}({std:.0f})"
    return f"{value:.{digits}f}({std * 10**digits:.0f})"


def printed_choice(selection: Selection) -> None:
    """Print which terms were added or dropped, and what spoke for it."""
    done = {"add": "added", "drop": "dropped"}
    for row in selection.steps:
        if row.chosen:
            say(
                f"{done[row.direction]}: {row.term}, chi-square {row.statistic:.4g} of "
                f"{row.parameters}, {selection.by} in favour by {row.worth:.4g}"
            )
    nothing = "" if selection.chosen else "no term was added; "
    say(f"{nothing}what was tried in every step: tables/selection.csv")
