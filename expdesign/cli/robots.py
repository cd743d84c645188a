"""Command `robots`: the robots that ship."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from constraints import Limit
from expdesign.cli.output import results, write_json
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files

_WIDEST = 100
"""Characters of a line that is still easy to read."""


def list_robots(*, as_json: bool) -> None:
    """List the robots that ship."""
    found = [load_robot_description(name) for name in robot_files()]
    if as_json:
        write_json([_as_data(robot) for robot in found])
        return
    console = results()
    for position, robot in enumerate(found):
        if position:
            console.print()
        console.print(robot.name, style="bold")
        console.print(_block(robot, min(console.width, _WIDEST)))


def _block(robot: ResolvedRobot, width: int) -> Table:

    block = Table.grid(padding=(0, 2, 0, 0))
    block.width = width
    block.add_column(no_wrap=True)
    block.add_column(overflow="fold")
    limits = "; ".join(_limit(limit) for limit in robot.limits.values())
    rows = {"geometry": _geometry(robot), "limits": limits, "source": robot.description.description}
    for name, text in rows.items():
        block.add_row(f"  {name}", text)
    return block


def _geometry(robot: ResolvedRobot) -> str:

    home = _home(robot)
    shortest, longest = (f"{end(home['strut_length']):.4g}" for end in (min, max))
    length = shortest if shortest == longest else f"{shortest} … {longest}"
    base, platform = (
        float(np.mean(np.hypot(joints[:, 0], joints[:, 1])))
        for joints in (robot.base_joints, robot.platform_joints)
    )
    pose = ", ".join(f"{value:.4g}" for value in robot.home)
    return (
        f"home {pose} (m, rad); struts at home {length} m; base radius {base:.4g} m; "
        f"platform radius {platform:.4g} m; {robot.platform} platform; "
        f"Jacobian condition at home {home['jacobian_condition']:.3g} "
        f"(L = {robot.characteristic_length:g} m)"
    )


def _home(robot: ResolvedRobot) -> dict[str, Any]:
    geometry = robot.struts_at(robot.home)
    return {
        "strut_length": geometry.lengths.tolist(),
        "jacobian_condition": geometry.condition(robot.characteristic_length),
    }


def _limit(limit: Limit) -> str:

    definition = limit.definition
    unit, factor = definition.unit, 1.0
    if unit == "rad":
        unit, factor = "deg", float(np.degrees(1.0))
    suffix = "" if unit == "1" else f" {unit}"
    rows = list(zip(limit.lower * factor, limit.upper * factor, strict=True))
    if definition.pairs:
        # Pairs that share a joint are left out; all others have the same bound.
        rows = [row for row in rows if np.any(np.isfinite(row))]
    if all(row == rows[0] for row in rows):
        return f"{definition.title} {range_text(rows[0])}{suffix}"
    parts = ", ".join(
        f"{label} {range_text(row)}" for label, row in zip(limit.labels, rows, strict=True)
    )
    return f"{definition.title} {parts}{suffix}"


def range_text(row: tuple[float, float]) -> str:
    """Return the bounds of a row as text: ``"±2"``, ``"0.45 … 0.95"``, ``"≤ 10"``, ``"free"``."""
    low, high = row
    if np.isinf(low) and np.isinf(high):
        return "free"
    if np.isinf(low):
        return f"≤ {high:.6g}"
    if np.isinf(high):
        return f"≥ {low:.6g}"
    return f"±{high:.6g}" if low == -high else f"{low:.6g} … {high:.6g}"


def _as_data(robot: ResolvedRobot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "description": robot.description.description,
        "file": str(robot.source),
        "platform": robot.platform,
        "terms": [term.name for term in robot.terms],
        "home": robot.home.tolist(),
        "base_joints": robot.base_joints.tolist(),
        "platform_joints": robot.platform_joints.tolist(),
        "at_home": _home(robot),
        "characteristic_length": robot.characteristic_length,
        "parameters": dict(robot.parameters),
        "limits": {
            key: {"lower": limit.lower.tolist(), "upper": limit.upper.tolist(), "unit": limit.unit}
            for key, limit in robot.limits.items()
        },
        "warnings": robot.warnings,
    }
