"""What a report says of combinations of parameters, of a design and of an estimate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from expdesign.experiment.combinations import KnownCombination
from results.notation import counted
from results.report.content import Block, TextBlock
from results.report.table import Column, ReportTable


def combination_blocks(
    key: str, found: Sequence[KnownCombination], asked: Iterable[str]
) -> tuple[Block, ...]:
    """Return the combinations in which others matter; nothing of a folder that has none.

    Parameters
    ----------
    key : str
        Name of the table in the page.
    found : sequence of KnownCombination
    asked : iterable of str
        The parameters that a design judges, or that were estimated.
    """
    together = [row for row in found if row.together]
    if not found:
        return ()
    regrouped = (name for row in found for name in row.regrouped.split(", ") if name)
    parameters = len({*asked, *regrouped})
    if not together:
        if len(found) == parameters:
            text = f"All {counted(parameters, 'parameter')} are identified each for itself."
        else:
            text = (
                f"{len(found)} of {counted(parameters, 'parameter')} are identified, each for "
                "itself; the others tell nothing that matters to these."
            )
        return (TextBlock(text),)
    columns = (
        Column("combination", kind="text", of="combination"),
        Column("unit", kind="text", of="unit"),
        Column("value", digits=5, of="value"),
        Column("σ", digits=3, of="std"),
        Column("σ / scale", "%", digits=3, of="rel_std_percent"),
        Column("σ of the first alone", digits=3, of="std_alone"),
        Column("regrouped into it", kind="text", of="regrouped"),
    )
    caption = (
        f"What is known only together: {len(found)} combinations of "
        f"{counted(parameters, 'parameter')} are identified, {len(found) - len(together)} of them "
        "single parameters as far as it matters. The first parameter of a combination gives it its "
        "unit; by itself it is known less well, or not at all"
    )
    return (ReportTable.of(key, caption, columns, together),)
