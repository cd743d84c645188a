"""Forward and backward steps from the robot's own terms to those that the data support."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from estimation.selection.criteria import Judge
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class SelectionRow:
    """One block that was tried in one step."""

    step: Annotated[int, described("1", "number of the step, from 1")]
    direction: Annotated[str, described("", "add or drop")]
    term: Annotated[str, described("", "the term that was tried")]
    beside: Annotated[str, described("", "candidates that were in the model beside it")]
    parameters: Annotated[int, described("1", "combinations of its parameters that are seen")]
    statistic: Annotated[
        float, described("1", "chi-square of the term beside the others, over the dispersion")
    ]
    log_p: Annotated[float, described("1", "logarithm of p of its F test, of this test alone")]
    samples: Annotated[
        float, described("1", "independent samples that would tell as much of its parameters")
    ]
    bic: Annotated[float, described("1", "change of Schwarz's criterion with the term")]
    held_out: Annotated[
        OpenNumber,
        described("1", "change of -2 log L of what was not fitted; empty: not asked for"),
    ]
    worth: Annotated[
        float, described("1", "by how much the criterion is in favour: it belongs there above 0")
    ]
    chosen: Annotated[bool, described("", "the step was done: the term was added, or dropped")]


def select(judge: Judge) -> tuple[tuple[str, ...], tuple[SelectionRow, ...]]:
    """Return the candidates that belong into the model, in the order of entry, and the path.

    Forward, the candidate that is worth most enters, if it is worth anything; after each entry
    those that are worth nothing beside the others leave, the least worthy first. It ends when
    neither changes the model, or brings back one that was there. A term that takes the constants of
    another enters after it, and leaves before it.
    """
    model: tuple[str, ...] = ()
    rows: list[SelectionRow] = []
    seen = {frozenset(model)}
    while True:
        for direction in ("drop", "add"):
            changed, tried = _step(judge, model, direction, len(rows) and rows[-1].step)
            rows += tried
            if changed != model:
                break
        if changed == model or frozenset(changed) in seen:
            return changed, tuple(rows)
        model = changed
        seen.add(frozenset(model))


def _step(
    judge: Judge, model: tuple[str, ...], direction: str, before: int
) -> tuple[tuple[str, ...], list[SelectionRow]]:
    """Return the model after one step of a kind, and what was tried."""
    adding = direction == "add"
    needed = judge.needs
    held = {needed[term] for term in model if term in needed}
    terms = [
        term
        for term in judge.evidence.blocks
        if (term in model) != adding
        and (needed.get(term, term) in (*model, term) if adding else term not in held)
    ]
    found = []
    for term in terms:
        others = tuple(other for other in model if other != term)
        one = judge.tried(term, others)
        found.append((one, others, judge.worth(one)))
    if not found:
        return model, []
    best = max(found, key=lambda each: each[2] if adding else -each[2])
    done = best[2] > 0 if adding else best[2] <= 0
    rows = [
        SelectionRow(
            step=before + 1,
            direction=direction,
            term=one.term,
            beside=" ".join(others),
            parameters=one.rank,
            statistic=one.statistic,
            log_p=one.log_p,
            samples=judge.samples[one.term],
            bic=-one.bic,
            held_out=-one.held_out,
            worth=worth,
            chosen=done and one is best[0],
        )
        for one, others, worth in found
    ]
    if not done:
        return model, rows
    return ((*model, best[0].term) if adding else best[1]), rows
