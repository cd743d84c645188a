"""What a motion does where nothing limits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from constraints import Limit, limit_definitions
from constraints.arrays import Array
from expdesign.configuration import quantity_text
from expdesign.configuration.open_rows import named_rows, open_in_words, open_rows
from expdesign.recheck.fine_grid import Motion, states_at
from expdesign.robot import LimitModel, Robot
from expdesign.runfolder import OpenNumber

POINTS = 2000
_DIGITS = 3


@dataclass(frozen=True)
class Unlimited:
    """How far a motion goes in a quantity that nothing limits.

    `value` is the smallest of a limit that bounds from below, and otherwise the largest size, of
    what has a range (rotations, lengths, joint angles) counted `from_home`. SI; `row` names the
    component, strut or pair of struts that it is of.
    """

    key: str
    title: str
    row: str
    value: OpenNumber
    unit: str
    from_home: bool

    def __str__(self) -> str:
        """Return it in words."""
        row = f" {self.row}" if self.row else ""
        away = " from home" if self.from_home else ""
        return f"{self.title}{row} {quantity_text(self.value, self.unit, _DIGITS)}{away}"


def unlimited(robot: Robot, motion: Motion, times: Array) -> tuple[Unlimited, ...]:
    """Return what a motion does at the times (N,), s, where neither robot nor run limit it.

    Of a limit on components every open component is told, of others the row that goes furthest.
    The times should be a fine grid: nothing is looked at between them.
    """
    found: list[Unlimited] = []
    open_ones = open_rows(robot.description)
    limits = tuple(Limit.boundless(one.definition, one.labels) for one in open_ones)
    model = LimitModel(robot, limits)
    values, at_home = model.values(states_at(motion, times)), model.at_home()
    for one, columns in zip(open_ones, model.columns, strict=True):
        definition = one.definition
        from_home = definition.kind == "interval"
        rows = values[:, columns][:, one.rows]
        if from_home:
            rows = rows - at_home[definition.key][one.rows]
        if definition.kind == "lower":
            extremes, furthest = rows.min(axis=0), np.argmin
        else:
            extremes, furthest = np.abs(rows).max(axis=0), np.argmax
        told = range(len(extremes)) if definition.components else [int(furthest(extremes))]
        found += [
            Unlimited(
                definition.key,
                definition.title,
                one.labels[one.rows[k]],
                float(extremes[k]),
                definition.unit,
                from_home,
            )
            for k in told
        ]
    return tuple(found)


def unlimited_warning(found: Sequence[Unlimited]) -> str:
    """Say which limits are not set and what a motion does there; empty where all are set."""
    known = limit_definitions()
    names = (
        named_rows(known[key], [one.row for one in rows])
        for key, rows in groupby(found, key=lambda one: one.key)
    )
    said = open_in_words(names)
    return f"{said}. There the motion reaches: {in_words(found)}" if said else ""


def in_words(found: Sequence[Unlimited]) -> str:
    """List what a motion reaches."""
    return "; ".join(str(one) for one in found)
