"""Precision that several designs predict for one experiment, and the time each needs for it."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from results.figures.comparison.series import ParameterSeries, Series
from results.report.comparison.designs import DesignComparison
from results.report.table import Column, ReportTable, Value


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
