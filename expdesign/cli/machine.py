"""Machine at home: lengths, forces, angles and reach, with a drawing, for `check --machine`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from constraints import Limit, limit_definitions
from constraints.arrays import Array
from expdesign.cli.output import results, say
from expdesign.cli.terminal import working
from expdesign.configuration import RunConfiguration
from expdesign.configuration.limits import row_labels, shared_rows
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.hexapod import ACTUATORS, POSE
from expdesign.recheck.excitable import Excitable, excitable
from expdesign.recheck.reach import SINGULAR, Reach, Stop, reach
from expdesign.robot import LimitModel, Robot
from expdesign.stages.execution import refuse_unwritable
from expdesign.stages.stage import short
from results.notation import DisplayUnit, handy_unit, range_text
from results.render.figures import draw_machine

_LIMIT, _FREE = "limit", range_text((-np.inf, np.inf))
_NOTHING = 1e-9
"""Share of a column's largest value that is rounding."""
_STRUTS = {"strut_length": "length", "actuator_force": "force", "alpha": "α", "beta": "β"}
"""Quantities of every strut, with the titles of their columns."""
_WHOLE = ("jacobian_condition", "strut_clearance", "tilt", "platform_joint_angle")
"""Quantities of the machine, shown by their worst row."""


def show_machine(
    configuration: RunConfiguration, robot: Robot, folder: Path, *, quiet: bool
) -> dict[str, Any]:
    """Compute, print and draw the machine at home; return the same for machines."""
    refuse_unwritable(folder)
    with working("check"):
        at_home, reaches = LimitModel.boundless(robot).at_home(), reach(robot)
        shown = excitable(robot)
        files = draw_machine(robot, folder, configuration.run.report.figures)
    if not quiet:
        print_machine(robot, at_home, reaches)
        say(f"{_count_identified(shown)}\n")
        say(f"drawn: {', '.join(short(file) for file in files)}")
    units = {key: definition.unit for key, definition in limit_definitions().items()}
    return {
        "machine": {
            "at_home": {
                key: {"values": values.tolist(), "unit": units[key]}
                for key, values in at_home.items()
            },
            "reach": {one.coordinate: asdict(one) for one in reaches},
            "base_parameters": {name: shown.base.members(name) for name in shown.base.base},
            "files": [str(file) for file in files],
        },
        "warnings": _unidentified_warnings(configuration, robot, shown),
    }


def _count_identified(found: Excitable) -> str:
    """Return the number of parameters that motions within the limits can identify."""
    count, every = len(found.base.base), len(found.base.names)
    if count == every:
        return f"Without noise, motions within the limits identify all {every} parameters."
    combined = [found.base.text(name) for name in found.base.combined]
    text = f"Without noise, motions within the limits identify {count} of {every} parameters"
    return f"{text}, together with others: {', '.join(combined)}." if combined else f"{text}."


def _unidentified_warnings(
    configuration: RunConfiguration, robot: Robot, found: Excitable
) -> list[str]:
    """Return warnings of parameters that no motion within the limits shows, or none measures."""
    warnings = []
    if found.base.regrouped:
        reasons = "; ".join(found.base.sentences())
        warnings.append(
            f"no motion within the limits identifies all parameters: {reasons}. Design and "
            "estimate the combinations (design.parameters: base, estimate.parameters: base), "
            "or omit a term"
        )
    run, noise = configuration.run, configuration.robot.noise
    if noise is None or noise.force_covariance is None or noise.force_spectrum is not None:
        return warnings
    longest = run.experiment.periods / run.trajectory.frequency[0]
    weak = found.beyond_noise(robot, longest * run.experiment.sampling)
    if weak:
        named = ", ".join(f"{name} ({100 * share:.2g} %)" for name, share in weak.items())
        warnings.append(
            f"no motion within the limits identifies {named} in {longest:.4g} s of measuring, the "
            "longest of this run: in brackets the standard deviation at best, which is to be below "
            f"{100 * IDENTIFIABLE:g} % of the value"
        )
    return warnings


def print_machine(robot: Robot, at_home: Mapping[str, Array], reaches: Sequence[Reach]) -> None:
    """Print lengths, forces and angles of the struts, condition and reach, with their limits.

    `at_home` is that of `LimitModel`, of everything that can be limited.
    """
    console = results()
    console.print(f"{robot.name} at rest at home: {_pose(robot)}\n")
    for table in (_struts(robot, at_home), _whole(robot, at_home), _reach(reaches)):
        console.print(table)
        console.print()


def _pose(robot: Robot) -> str:
    parts = []
    for unit in dict.fromkeys(one.unit for one in POSE):
        mine = [(one.name, v) for one, v in zip(POSE, robot.home, strict=True) if one.unit == unit]
        shown = handy_unit(unit, [value for _, value in mine])
        values = ", ".join(f"{name} {shown.number(value)}" for name, value in mine)
        parts.append(f"{values}{_symbol(shown)}")
    return "; ".join(parts)


def _struts(robot: Robot, at_home: Mapping[str, Array]) -> Table:
    heads, columns = ["strut"], [[*(str(j + 1) for j in range(ACTUATORS)), _LIMIT]]
    for key, name in _STRUTS.items():
        limit, values = _limit(robot, key), at_home[key]
        unit = handy_unit(limit.unit, [*values, *limit.lower, *limit.upper])
        cells, bounds = [_number(unit, value, values) for value in values], _ranges(limit, unit)
        if len(set(bounds)) > 1:
            cells = [f"{cell} ({own})" for cell, own in zip(cells, bounds, strict=True)]
            bounds = [""]
        heads.append(f"{name} [{unit.symbol}]")
        columns.append([*cells, bounds[0]])
    table = _table("Struts", heads, right=heads[1:])
    for row in zip(*columns, strict=True):
        table.add_row(*row, style="dim" if row[0] == _LIMIT else None)
    return table


def _whole(robot: Robot, at_home: Mapping[str, Array]) -> Table:
    table = _table("Machine", ("", "at home", "of", _LIMIT), right=("at home",))
    always = [key for key in robot.description.limits if limit_definitions()[key].standing]
    for key in (*_WHOLE, *always):
        limit, values = _limit(robot, key), at_home[key]
        definition = limit.definition
        rows = np.flatnonzero(~shared_rows(definition, robot.description.shared_joint_pairs))
        row = int(rows[(np.argmin if definition.kind == "lower" else np.argmax)(values[rows])])
        unit = handy_unit(limit.unit, values[rows])
        several = float(np.ptp(values[rows])) > _NOTHING * float(np.max(np.abs(values)))
        bounds = _ranges(limit, unit)[row]
        table.add_row(
            definition.title,
            f"{_number(unit, float(values[row]), values)}{_symbol(unit)}",
            limit.labels[row] if several else "",
            bounds if bounds == _FREE else f"{bounds}{_symbol(unit)}",
        )
    return table


def _reach(reaches: Sequence[Reach]) -> Table:
    title = "From home along one coordinate, at rest, until a limit stops it"
    heads = ("", "back", "stopped by", "ahead", "stopped by")
    table = _table(title, heads, right=("back", "ahead"))
    for one in reaches:
        cells = []
        for sign, stop in (("−", one.back), ("+", one.ahead)):
            unit = handy_unit(one.unit, [stop.travel])
            cells += [f"{sign}{unit.quantity(stop.travel)}", _stop_text(stop)]
        table.add_row(one.coordinate, *cells)
    return table


def _stop_text(stop: Stop) -> str:
    """Return the limit that stops a coordinate: ``"strut length 950 mm, strut 2"``."""
    if stop.bound is None:
        return stop.title if stop.limit == SINGULAR else "nothing so far"
    bound = handy_unit(stop.unit, [stop.bound]).quantity(stop.bound)
    # Of a limit on components it is the coordinate itself that reaches it.
    components = limit_definitions()[stop.limit].components
    rows = [row for row in stop.rows if row and row not in components]
    return ", ".join([f"{stop.title} {bound}", *rows])


def _limit(robot: Robot, key: str) -> Limit:
    definition = limit_definitions()[key]
    return robot.limit(key) or Limit.boundless(definition, row_labels(definition))


def _ranges(limit: Limit, unit: DisplayUnit) -> list[str]:
    """Return the bounds of each row as text, without the unit."""
    lower, upper = (unit.shown(side).tolist() for side in (limit.lower, limit.upper))
    return [range_text(row).replace("-", "−") for row in zip(lower, upper, strict=True)]


def _symbol(unit: DisplayUnit) -> str:
    return f" {unit.symbol}" if unit.symbol not in ("", "°") else unit.symbol


def _number(unit: DisplayUnit, value: float, column: Array) -> str:
    """Return a value of a column, with rounding errors as zero."""
    largest = float(np.max(np.abs(column)))
    return unit.number(0.0 if abs(value) <= _NOTHING * max(largest, 1.0) else value)


def _table(title: str, heads: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.pad_edge, table.show_edge = False, False
    for head in heads:
        table.add_column(head, justify="right" if head in right else "left")
    return table
