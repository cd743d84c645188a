"""Tables of several designs: criteria, precision, effort and limits."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from results.figures.parameters import ParameterSeries, Series
from results.report.comparison.designs import COUNTED, ComparedDesign, DesignComparison
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


def relative_std(comparison: DesignComparison, samples: float) -> dict[str, Array]:
    """Return σ relative to each design's own nominal values, (m,); NaN where there is none."""
    return {
        design.label: design.std(samples)
        / np.where(design.nominal == 0, np.nan, np.abs(design.nominal))
        for design in comparison.designs
    }


def periods_needed(comparison: DesignComparison) -> dict[str, Array]:
    """Return the periods that each parameter needs for the precision wanted, by design."""
    found = {}
    for design in comparison.designs:
        one = relative_std(comparison, design.period * comparison.sampling)[design.label]
        found[design.label] = np.maximum(np.ceil((one / comparison.precision) ** 2 - 1e-9), 1.0)
    return found


def precision_table(comparison: DesignComparison) -> ReportTable:
    """Return predicted standard deviations and the periods needed, one row per parameter."""
    relative, periods = (
        relative_std(comparison, comparison.experiment_samples),
        periods_needed(comparison),
    )
    shown = comparison.designs[:1] if comparison.same_nominal else comparison.designs
    columns = [Column("parameter", kind="parameter")]
    if comparison.same_nominal:
        columns.append(Column("nominal"))
    else:
        columns += [Column(f"nominal, {design.label}") for design in shown]
    columns += [Column(f"σ, {design.label}", "%", digits=3) for design in comparison.designs]
    columns += [Column(f"periods, {design.label}") for design in comparison.designs]
    rows: list[tuple[Value, ...]] = [
        (
            name,
            *(float(design.nominal[k]) for design in shown),
            *(100 * float(relative[design.label][k]) for design in comparison.designs),
            *(float(periods[design.label][k]) for design in comparison.designs),
        )
        for k, name in enumerate(comparison.designs[0].names)
    ]
    caption = (
        f"Predicted standard deviations for {comparison.experiment_samples} samples at "
        f"{comparison.sampling:g} Hz whatever the period, scaled by √samples from what each design "
        f"states for its own experiment, in percent of {_whose(comparison)}, and the periods that "
        f"each design needs for {100 * comparison.precision:g} %"
    )
    return ReportTable.of("compared_parameters", caption, columns, rows)


def precision_series(comparison: DesignComparison) -> ParameterSeries:
    """Return what the figure of the precision is drawn from."""
    relative = relative_std(comparison, comparison.experiment_samples)
    return ParameterSeries(
        comparison.designs[0].names,
        tuple(Series(label, 100 * values) for label, values in relative.items()),
    )


def effort_table(comparison: DesignComparison) -> ReportTable:
    """Return the measuring time that each design needs, one row per design."""
    periods = periods_needed(comparison)
    rows: list[tuple[Value, ...]] = []
    for design in comparison.designs:
        needed = periods[design.label]
        known = bool(np.any(np.isfinite(needed)))
        worst = int(np.nanargmax(needed)) if known else 0
        summary = design.record.summary
        rows.append(
            (
                design.label,
                summary.status,
                summary.criterion,
                summary.harmonics,
                design.period,
                float(np.nanmedian(needed)) if known else None,
                float(needed[worst]) if known else None,
                design.names[worst] if known else "–",
                float(needed[worst]) * design.period if known else None,
            )
        )
    columns = (
        Column("design", kind="text"),
        Column("status", kind="outcome"),
        Column("criterion", kind="text"),
        Column("harmonics"),
        Column("period", "s"),
        Column("periods, median parameter"),
        Column("periods, all parameters"),
        Column("decided by", kind="parameter"),
        Column("measuring time", "s"),
    )
    caption = (
        f"Periods and time that each design needs for σ = {100 * comparison.precision:g} % of "
        f"{_whose(comparison)}, measured at {comparison.sampling:g} Hz"
    )
    return ReportTable.of("effort", caption, columns, rows)


def _whose(comparison: DesignComparison) -> str:
    return "the nominal value" if comparison.same_nominal else "its own robot's nominal value"


def limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    """Return the used share of every limit, one column per design."""
    checks = [{check.key: check for check in design.record.checks} for design in designs]
    titles = {check.key: check.title for own in checks for check in own.values()}
    columns = [Column("limit", kind="text"), *(Column(design.label, "%") for design in designs)]
    rows = [
        (title, *(100 * own[key].used if key in own else None for own in checks))
        for key, title in titles.items()
    ]
    return ReportTable.of("compared_limits", "Used share of every limit", columns, rows)
