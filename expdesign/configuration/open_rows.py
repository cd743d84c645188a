"""Descriptions of a robot's limits: open ones, defaults, implied ones, and the reserve."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints import Limit, LimitDefinition, limit_definitions
from expdesign.configuration.limits import LIFTED, row_labels, shared_rows
from expdesign.configuration.quantity import quantity_text
from expdesign.configuration.robot import ResolvedRobot


@dataclass(frozen=True, eq=False)
class OpenRows:
    """Rows of a limit without any bound."""

    definition: LimitDefinition
    labels: tuple[str, ...]
    """Name of each row of the limit."""
    rows: NDArray[np.intp]
    """(k,), indices of the open rows."""

    def __str__(self) -> str:
        """Return the name of the limit, with its open components."""
        return named_rows(self.definition, [self.labels[row] for row in self.rows])


def open_rows(robot: ResolvedRobot) -> tuple[OpenRows, ...]:
    """Return the limits that neither robot nor run bounds, in the order of the catalogue.

    Pairs of struts with a common joint, and limits that always apply, do not count as open.
    """
    found = []
    for key, definition in limit_definitions().items():
        if definition.standing is not None:
            continue
        labels = row_labels(definition)
        limit = robot.limits.get(key) or Limit.boundless(definition, labels)
        shared = shared_rows(definition, robot.shared_joint_pairs)
        rows = np.flatnonzero(limit.open_rows & ~shared)
        if rows.size:
            found.append(OpenRows(definition, labels, rows))
    return tuple(found)


def named_rows(definition: LimitDefinition, labels: Iterable[str]) -> str:
    """Return the name of a limit, with the given components."""
    return f"{definition.key} ({', '.join(labels)})" if definition.components else definition.key


def open_in_words(found: Iterable[OpenRows | str]) -> str:
    """Describe the limits that are not set, by their rows or names; empty if all are."""
    names = ", ".join(str(one) for one in found)
    return f"no limit is set on {names}" if names else ""


def defaults_in_words(robot: ResolvedRobot) -> tuple[str, ...]:
    """Describe the default bounds in use."""
    found = []
    for limit in robot.limits.values():
        about, standing = limit.definition.about_home, limit.definition.standing
        if limit.by_default and about is not None:
            found.append(
                f"limits.{limit.key} is not given for {', '.join(limit.by_default)}: "
                f"{quantity_text(about, limit.unit)} from home in both directions by default; "
                f"`{limit.key}: {LIFTED}` lifts it"
            )
        elif limit.by_default and standing is not None:
            found.append(
                f"limits.{limit.key} is not given: {quantity_text(standing, limit.unit)} in both "
                "directions; this default cannot be lifted"
            )
    return tuple(found)


def held_in_words(robot: ResolvedRobot) -> tuple[str, ...]:
    """Describe the limits that always apply and are implied by another limit."""
    found = []
    for key, definition in limit_definitions().items():
        bound, other = definition.standing, definition.held_by(robot.limits)
        if key not in robot.limits and bound is not None and other is not None:
            found.append(
                f"{definition.title} stays within {quantity_text(bound, definition.unit)} either "
                f"way (limits.{key}): limits.{other} is tighter"
            )
    return tuple(found)


def reserve_in_words(robot: ResolvedRobot) -> str:
    """Describe the shares of the limits' ranges that stay free; empty without a reserve."""
    by_share: dict[float, list[str]] = {}
    for limit in robot.limits.values():
        by_share.setdefault(limit.reserve, []).append(limit.key)
    kept = {share: keys for share, keys in sorted(by_share.items()) if share}
    if not kept:
        return ""
    of = "; ".join(
        f"{100 * share:.4g} % of {'every limit' if len(by_share) == 1 else ', '.join(keys)}"
        for share, keys in kept.items()
    )
    return f"limits.reserve keeps free {of}: motions are planned and judged within the rest"
