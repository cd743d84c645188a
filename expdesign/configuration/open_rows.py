"""Which limits a robot leaves open, and which of them a default bounds then."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints import Limit, LimitDefinition, limit_definitions
from expdesign.configuration.limits import LIFTED, row_labels, with_shared_joints
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.values.quantity import quantity_text


@dataclass(frozen=True, eq=False)
class OpenRows:
    """Rows of a limit that are bounded on neither side."""

    definition: LimitDefinition
    labels: tuple[str, ...]
    """What each row of the limit stands for."""
    rows: NDArray[np.intp]
    """(k,), which of them are open."""

    def __str__(self) -> str:
        """Name the limit, and of one by components those that are open."""
        definition = self.definition
        names = ", ".join(self.labels[row] for row in self.rows)
        return f"{definition.key} ({names})" if definition.components else definition.key


def open_rows(robot: ResolvedRobot) -> tuple[OpenRows, ...]:
    """Return what neither robot nor run limits, in the order of the catalogue.

    A pair of struts that shares a joint has no clearance: it is not open.
    """
    found = []
    for key, definition in limit_definitions().items():
        labels = row_labels(definition)
        rows = np.flatnonzero(_open(robot.limits.get(key), len(labels)))
        if definition.pairs:
            rows = np.setdiff1d(rows, _without_gap(definition, robot))
        if rows.size:
            found.append(OpenRows(definition, labels, rows))
    return tuple(found)


def open_in_words(found: Iterable[OpenRows]) -> str:
    """Say which limits are not set; empty where all are."""
    names = ", ".join(str(one) for one in found)
    return f"no limit is set on {names}" if names else ""


def defaults_in_words(robot: ResolvedRobot) -> tuple[str, ...]:
    """Say of each limit with a default what nobody has bounded, and what bounds it."""
    return tuple(
        f"limits.{limit.key} is not given for {', '.join(limit.by_default)}: "
        f"{quantity_text(limit.definition.about_home or 0.0, limit.unit)} from home either way by "
        f"default; `{limit.key}: {LIFTED}` lifts it"
        for limit in robot.limits.values()
        if limit.by_default
    )


def _open(limit: Limit | None, count: int) -> NDArray[np.bool_]:
    return np.ones(count, dtype=bool) if limit is None else limit.open_rows


def _without_gap(definition: LimitDefinition, robot: ResolvedRobot) -> NDArray[np.intp]:
    labels = row_labels(definition)
    bounded = Limit(definition, np.zeros(len(labels)), np.ones(len(labels)), labels, "")
    return np.flatnonzero(np.isinf(with_shared_joints(bounded, robot.shared_joint_pairs).lower))
