"""Criteria of several designs in a common scaling, and their efficiencies."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from results.report.comparison.designs import ComparedDesign, DesignComparison
from results.report.comparison.machines import COUNTED
from results.report.table import Column, ReportTable, Value


def efficiencies(comparison: DesignComparison) -> dict[str, float | None]:
    """Return the D-efficiency of each design relative to the best of its machine.

    None where F is singular, and for the only design of a machine among several machines.
    """
    count = len(comparison.designs[0].names)
    found: dict[str, float | None] = {}
    for designs in comparison.machines:
        values = {design.label: design.log_det(comparison.samples) for design in designs}
        known = [value for value in values.values() if value is not None]
        alone = len(designs) == 1 and len(comparison.machines) > 1
        for label, value in values.items():
            found[label] = (
                None if value is None or alone else float(np.exp((value - max(known)) / count))
            )
    return found


def criteria_table(comparison: DesignComparison) -> ReportTable:
    """Return all criteria in both scalings, one row per design."""
    shares = efficiencies(comparison)
    rows: list[tuple[Value, ...]] = []
    for design in comparison.designs:
        covariance = design.covariance(comparison.samples)
        cells: list[Value] = []
        scale = _nominal_scale(design)
        for scaling in (np.ones_like(scale), scale):
            cells += _spectrum(design.information * comparison.samples, covariance, scaling)
        efficiency = shares[design.label]
        rows.append(
            (
                design.label,
                design.log_det(comparison.samples),
                None if efficiency is None else 100 * efficiency,
                *cells,
            )
        )
    columns = [Column("design", kind="text"), Column("log det F", digits=6)]
    columns.append(Column("D-efficiency", "%"))
    for scaling_name in ("SI", "nominal"):
        columns += [
            Column(f"trace F⁻¹, {scaling_name}"),
            Column(f"smallest eigenvalue, {scaling_name}"),
            Column(f"condition, {scaling_name}"),
        ]
    whose = "the nominal values" if comparison.same_nominal else "each one's own nominal values"
    best = "the best"
    if len(comparison.machines) > 1:
        best += (
            f" of the same robot ({COUNTED}), empty where no other design is of it: the "
            "information of different robots differs by the machine and not only by the design"
        )
    caption = (
        f"Criteria of every design for {comparison.samples} samples, in SI units and in units of "
        f"{whose}; D-efficiency relative to {best}"
    )
    return ReportTable.of("criteria", caption, columns, rows)


def _nominal_scale(design: ComparedDesign) -> Array:
    robot = design.record.robot
    places = [robot.parameter_names.index(name) for name in design.names]
    return robot.scales[places]


def _spectrum(information: Array, covariance: Array | None, scale: Array) -> list[Value]:
    """Return trace of F⁻¹, smallest eigenvalue and condition number in a scaling."""
    if covariance is None:
        return [None, None, None]
    scaled = information * np.multiply.outer(scale, scale)
    inverse = covariance / np.multiply.outer(scale, scale)
    # The small eigenvalues come from the inverse, where they keep their digits.
    smallest = 1 / float(np.linalg.eigvalsh(inverse)[-1])
    largest = float(np.linalg.eigvalsh(scaled)[-1])
    return [float(np.trace(inverse)), smallest, largest / smallest]
