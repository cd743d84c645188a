"""Blocks about parameters that designs and estimates share: symbols, combinations, quantities."""

from __future__ import annotations

import operator
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from expdesign.information.identifiable import KnownCombination
from expdesign.mechanism.terms import term_definitions
from expdesign.robot.derived import ALONE, GRAVITY_FORCE, KnownQuantity
from results.notation import DisplayUnit, concise, count_text, handy_unit
from results.views.view import Block, ReportTable, TableColumn, TextBlock


def symbols_blocks(
    names: Iterable[str], *, screen: bool, left_out: Collection[str] = ()
) -> tuple[TextBlock, ...]:
    """Return the meaning of every parameter among the names; nothing without any.

    On a screen it is short: without details and the names `left_out`, and with names whose
    meanings differ in words of the same place together.

    >>> names = ["p10", "r1", "r2", "r3", "v1", "v2", "v3", "mass"]
    >>> (block,) = symbols_blocks(names, screen=True)
    >>> block.text.partition("; ")[0]
    'p10: mass of the platform and the six sliders'
    >>> block.short.partition("; ")[2]
    'r1 … r3/v1 … v3: dry/viscous friction of the actuators.'
    """
    known = {one.name: one for term in term_definitions().values() for one in term.parameters}
    full: dict[str, list[str]] = {}
    short: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        if name in known:
            words = known[name].in_words
            full.setdefault(words, []).append(name)
            if name not in left_out:
                short.setdefault(_DETAIL.split(words)[0], []).append(name)
    if not full:
        return ()
    listed = [f"{_ends(group)}: {words}" for words, group in full.items()]
    together = [
        f"{'/'.join(map(_ends, groups))}: {' '.join(map(_alternatives, zip(*words, strict=True)))}"
        for groups, words in _similar(short)
    ]
    text, brief = (f"{'; '.join(parts)}." for parts in (listed, together))
    return (TextBlock(text, screen=screen, short=brief),)


_DETAIL = re.compile(r"[,;:] ")


def _similar(
    groups: Mapping[str, Sequence[str]],
) -> list[tuple[list[Sequence[str]], list[list[str]]]]:
    """Return neighbours whose meanings differ in few words, together."""
    found: list[tuple[list[Sequence[str]], list[list[str]]]] = []
    for text, names in groups.items():
        words = text.split()
        if found:
            others, before = found[-1]
            if sum(map(operator.ne, words, before[0])) <= _FEW and len(words) == len(before[0]):
                others.append(names)
                before.append(words)
                continue
        found.append(([names], [words]))
    return found


_FEW = 1
"""Number of words in which meanings differ that a screen joins."""


def _alternatives(words: Sequence[str]) -> str:
    return "/".join(dict.fromkeys(words))


def _ends(names: Sequence[str]) -> str:
    return f"{names[0]} … {names[-1]}" if len(names) > 2 else ", ".join(names)  # noqa: PLR2004


def combination_blocks(
    key: str, found: Sequence[KnownCombination], asked: Iterable[str], *, most: int = 4
) -> tuple[Block, ...]:
    """Return the combinations of several parameters; nothing for a result that has none.

    `key` is the name of the table in the page, `asked` are the parameters that a design judges, or
    that were estimated. The terminal lists so many combinations at `most`.
    """
    together = [row for row in found if row.together]
    if not together:
        regrouped = (name for row in found for name in row.regrouped.split(", ") if name)
        if not found or len(found) == len({*asked, *regrouped}):
            return ()
        return (TextBlock("The parameters that are not identified do not affect the others."),)
    columns = (
        TableColumn("combination", kind="text", of="combination"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("value", digits=5, of="value"),
        TableColumn("σ", kind="error", digits=3, of="std"),
        TableColumn("σ / scale", "%", digits=3, of="rel_std_percent"),
        TableColumn("σ of the first alone", digits=3, of="std_alone"),
        TableColumn("regrouped into it", kind="text", of="regrouped"),
    )
    shown = [
        f"{row.combination} = {concise(row.value, row.std)} {row.unit}" for row in together[:most]
    ]
    if len(together) > most:
        more = f"{len(together) - most} more" if most else count_text(len(together), "combination")
        shown.append(f"{more} in the report")
    caption = (
        "Combinations that are known better than their first parameter alone, each in its unit"
    )
    return (
        TextBlock(f"Known better together than alone: {'; '.join(shown)}.", screen=True),
        ReportTable.of(key, caption, columns, together),
    )


def derived_blocks(
    key: str, found: Sequence[KnownQuantity], whose: str, *, brief: bool = False
) -> list[Block]:
    """Return the table of derived quantities; nothing without any.

    `key` is its name in the page; `whose` completes the caption: ``"of the ML estimate"``. A brief
    screen leaves out products of inertia, and forces at rest that are not equal.
    """
    if not found:
        return []

    def unit(row: KnownQuantity) -> DisplayUnit:
        return handy_unit(row.unit, [row.value])

    def column(label: str, of: str, digits: int = 3) -> TableColumn:
        return TableColumn(label, digits=digits, of=lambda row: unit(row).factor * getattr(row, of))

    alone = {one.quantity: one for one in found if one.quantity.startswith(ALONE)}

    def of_the_platform(row: KnownQuantity) -> str:
        own = alone.get(ALONE + row.quantity)
        factor = unit(row).factor
        return "" if own is None else concise(factor * own.value, factor * own.std)

    intervals = hasattr(found[0], "ci_low")  # of an estimate
    shared = any(row.std_systematic > 0 for row in found)
    on_page = [
        TableColumn("σ / value", "%", digits=3, of="rel_std_percent"),
        *([column("σ random", "std_random"), column("σ systematic", "std_systematic")] * shared),
        *([TableColumn("largest source", kind="text", of="source")] * shared),
        *([column("95 % from", "ci_low", 5), column("95 % to", "ci_high", 5)] * intervals),
    ]
    columns = (
        TableColumn("quantity", kind="text", of="quantity"),
        TableColumn("unit", kind="text", of=lambda row: unit(row).symbol),
        column("value", "value", 5),
        replace(column("σ", "std"), kind="error"),
        *([TableColumn("platform alone", kind="text", of=of_the_platform)] if alone else []),
        *(replace(each, screen=False) for each in on_page),
    )
    separated = ": only the sum is identifiable without bodies.slider of the robot file"
    if alone:
        separated = ", alone: less the sliders and payload of the robot file, as exact"
    at_rest = "" if brief else "; forces at rest at home"
    caption = f"Quantities {whose} (platform with sliders{separated}{at_rest})"
    rows = [one for one in _merge_equal(found) if one.quantity not in alone]
    table = ReportTable.of(key, caption, columns, rows, screen=True, latex=True)
    rest = (k for k, row in enumerate(rows) if _MINOR.fullmatch(row.quantity))
    return [replace(table, left_out=frozenset(rest if brief else ()))]


_MINOR = re.compile(rf"{GRAVITY_FORCE}\d|inertia_(xy|xz|yz)")
"""Quantities that a brief screen leaves out."""


def _merge_equal(found: Sequence[KnownQuantity]) -> Iterator[KnownQuantity]:
    """Yield the quantities; those of all actuators in one row if they are equal."""
    numbered = [one for one in found if one.quantity.startswith(GRAVITY_FORCE)]
    values, stds = (np.array([getattr(one, of) for one in numbered]) for of in ("value", "std"))
    equal = len(numbered) > 1 and np.ptp(values) < _EQUAL * np.min(stds)
    yield from (one for one in found if not (equal and one in numbered))
    if equal:
        yield replace(numbered[0], quantity=f"{GRAVITY_FORCE}1 … {len(numbered)}")


_EQUAL = 1e-3
"""Largest difference of equal quantities, in standard deviations."""
