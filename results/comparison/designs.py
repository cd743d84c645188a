"""Comparison of designs: criteria, precision, effort, limits and their costs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.experiment import DesignResult
from expdesign.experiment.sensitivity import LimitSensitivity, limit_sensitivity
from expdesign.information.criteria import criteria
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.progress import track
from results.comparison.compared_design import COUNTED, ComparedDesign, DesignComparison
from results.figures.parameters import ParameterSeries, compared_precision_figure
from results.notation import counted, duration, percent
from results.views.design import EXPLAINED, costliest_fact, gains_table
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    Value,
)


def compare_designs(
    folders: Mapping[str, RunFolder], precision: float, quick: bool = False
) -> StageView:
    """Return the comparison of the designs of folders; a quick one without the costs of limits."""
    designs = tuple(
        ComparedDesign(label, folder.result(DesignResult)) for label, folder in folders.items()
    )
    costs: dict[str, LimitSensitivity] = {}
    if not quick:
        costs = {
            design.label: limit_sensitivity(design.result.configuration, design.result.trajectory)
            for design in track("cost of each limit", designs)
        }
    return designs_view(DesignComparison(designs, precision), costs)


def designs_view(comparison: DesignComparison, costs: Mapping[str, LimitSensitivity]) -> StageView:
    """Return the view of a comparison of designs, with the costs of their limits."""
    designs = comparison.designs
    blocks: list[Block] = []
    facts: list[Fact] = []
    sentence = f"{counted(len(designs), 'design')}."
    if comparison.comparable:
        blocks += [
            _criteria_table(comparison),
            Drawing(compared_precision_figure, precision_series(comparison)),
            _effort_table(comparison),
            _precision_table(comparison),
        ]
        text, best = _efficiencies_in_words(comparison)
        sentence += text
        facts += best
    blocks.append(_limits_table(designs))
    if costs:
        blocks.append(gains_table(costs, "the optimum next to the design"))
        found = (costliest_fact(cost, f"{label}: ") for label, cost in costs.items())
        facts += [fact for fact in found if fact is not None]
        if any(each.unexplained > EXPLAINED for each in costs.values()):
            text = (
                "Where the limits leave more than 10 % of the cost's gradient unexplained, the "
                "design is not near an optimum, and the costs of its limits are not shown."
            )
            blocks.append(TextBlock(text, Level.CAUTION))
    # No column of a table: tables are the same bytes whenever the same seeds were used.
    seconds = {design.label: design.result.solver.seconds for design in designs}
    each = ", ".join(f"{label}: {duration(value)}" for label, value in seconds.items())
    facts.append(Fact("search", duration(sum(seconds.values())), each))
    verdict = StageVerdict("Designs", Level.NEUTRAL, "compared", sentence, "designs")
    return StageView(verdict, tuple(blocks), tuple(facts), comparison.differences())


def _efficiencies_in_words(comparison: DesignComparison) -> tuple[str, list[Fact]]:
    """Return the design with the most information and the others' efficiencies, by machine."""
    every = _efficiencies(comparison)
    several, log_det = len(comparison.machines) > 1, _log_det(comparison)
    text, facts = "", []
    for designs in comparison.machines:
        shares = {
            design.label: share for design in designs if (share := every[design.label]) is not None
        }
        if not shares:
            continue
        best = max(shares, key=lambda label: shares[label])
        others = ", ".join(
            f"{label} has {percent(value)} of its information per parameter"
            for label, value in shares.items()
            if label != best
        )
        among = f" of {' and '.join(shares)}" if several else ""
        text += f" {best} has the largest {log_det}{among}{f'; {others}' if others else ''}."
        facts.append(Fact(f"largest {log_det}", best, f"for {comparison.samples} samples"))
    if several:
        text += (
            f" They are for {len(comparison.machines)} different robots ({COUNTED}), between which "
            "there is no efficiency; precision is relative to each one's own nominal values."
        )
    return text, facts


def _information(comparison: DesignComparison) -> str:
    """Return the symbol of the compared information: F, or S of designs with a prior."""
    sections = [design.result.configuration.run.design for design in comparison.designs]
    symbols = sorted({one.information for one in sections})
    return symbols[0] if len(symbols) == 1 else f"({' or '.join(symbols)})"


def _log_det(comparison: DesignComparison) -> str:
    return criteria()["d"].named(_information(comparison))


def _efficiencies(comparison: DesignComparison) -> dict[str, float | None]:
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


def _criteria_table(comparison: DesignComparison) -> ReportTable:
    """Return all criteria in both scalings, one row per design."""
    designs, samples, shares = comparison.designs, comparison.samples, _efficiencies(comparison)
    columns = [
        TableColumn("design", kind="text", of=[design.label for design in designs]),
        TableColumn(
            _log_det(comparison), digits=6, of=[design.log_det(samples) for design in designs]
        ),
        TableColumn(
            "D-efficiency", "%", factor=100, of=[shares[design.label] for design in designs]
        ),
    ]
    for name, scaled in (("SI", False), ("nominal", True)):
        spectra = [_spectrum(design, samples, scaled=scaled) for design in designs]
        trace, smallest, condition = zip(*spectra, strict=True)
        columns += [
            TableColumn(f"trace {_information(comparison)}⁻¹, {name}", of=trace),
            TableColumn(f"smallest eigenvalue, {name}", of=smallest),
            TableColumn(f"condition, {name}", of=condition),
        ]
    whose = "the nominal values" if comparison.same_nominal else "each one's own nominal values"
    best = "the best"
    if len(comparison.machines) > 1:
        best += (
            f" of the same robot ({COUNTED}), empty where no other design is of it: the "
            "information of different robots differs by the machine and not only by the design"
        )
    caption = (
        f"Criteria of every design for {samples} samples, in SI units and in units of "
        f"{whose}; D-efficiency relative to {best}"
    )
    return ReportTable.of("criteria", caption, columns)


def _spectrum(design: ComparedDesign, samples: float, *, scaled: bool) -> tuple[float | None, ...]:
    """Return trace of F⁻¹, smallest eigenvalue and condition number, in SI or nominal scaling."""
    covariance, robot = design.covariance(samples), design.result.robot
    if covariance is None:
        return None, None, None
    places = [robot.parameter_names.index(name) for name in design.names]
    scale = robot.scales[places] if scaled else np.ones(len(places))
    outer = np.multiply.outer(scale, scale)
    inverse = covariance / outer
    # The small eigenvalues come from the inverse, where they keep their digits.
    smallest = 1 / float(np.linalg.eigvalsh(inverse)[-1])
    largest = float(np.linalg.eigvalsh(design.information * samples * outer)[-1])
    return float(np.trace(inverse)), smallest, largest / smallest


def _relative_std(design: ComparedDesign, samples: float) -> Array:
    """Return σ relative to the design's own nominal values, (m,); NaN where there is none."""
    return design.std(samples) / np.where(design.nominal == 0, np.nan, np.abs(design.nominal))


def _periods_needed(comparison: DesignComparison) -> dict[str, Array]:
    """Return the periods that each parameter needs for the precision wanted, by design."""
    one = {d.label: _relative_std(d, d.period * comparison.sampling) for d in comparison.designs}
    return {
        label: np.maximum(np.ceil((relative / comparison.precision) ** 2 - 1e-9), 1.0)
        for label, relative in one.items()
    }


def _precision_table(comparison: DesignComparison) -> ReportTable:
    """Return predicted standard deviations and the periods needed, one row per parameter."""
    designs, periods = comparison.designs, _periods_needed(comparison)
    shown = designs[:1] if comparison.same_nominal else designs
    columns = [TableColumn("parameter", kind="parameter", of=designs[0].names)]
    for design in shown:
        whose = "" if comparison.same_nominal else f", {design.label}"
        columns.append(TableColumn(f"nominal{whose}", of=design.nominal))
    columns += [
        TableColumn(f"σ, {label}", "%", digits=3, of=percents)
        for label, percents in precision_series(comparison).values.items()
    ]
    columns += [TableColumn(f"periods, {label}", of=own) for label, own in periods.items()]
    caption = (
        f"Predicted standard deviations for {comparison.experiment_samples} samples at "
        f"{comparison.sampling:g} Hz whatever the period, scaled by √samples from what each design "
        f"states for its own experiment, in percent of {_whose(comparison)}, and the periods that "
        f"each design needs for {100 * comparison.precision:g} %"
    )
    return ReportTable.of("compared_parameters", caption, columns)


def precision_series(comparison: DesignComparison) -> ParameterSeries:
    """Return the series of the precision figure."""
    samples, designs = comparison.experiment_samples, comparison.designs
    percents = {design.label: 100 * _relative_std(design, samples) for design in designs}
    return ParameterSeries(designs[0].names, percents)


def _effort_table(comparison: DesignComparison) -> ReportTable:
    """Return the measuring time that each design needs, one row per design."""
    designs, periods = comparison.designs, _periods_needed(comparison)
    summaries = [design.result for design in designs]
    hopeless = _hopeless(comparison)
    efforts = [
        _effort(design, np.where(hopeless, np.nan, periods[design.label])) for design in designs
    ]
    median, most, decisive, duration = zip(*efforts, strict=True)
    columns = (
        TableColumn("design", kind="text", of=[design.label for design in designs]),
        TableColumn("status", kind="outcome", of=[summary.status for summary in summaries]),
        TableColumn("criterion", kind="text", of=[summary.criterion for summary in summaries]),
        TableColumn("harmonics", of=[summary.harmonics for summary in summaries]),
        TableColumn("period", "s", of=[design.period for design in designs]),
        TableColumn("periods, median parameter", of=median),
        TableColumn("periods, all parameters", of=most),
        TableColumn("decided by", kind="parameter", of=decisive),
        TableColumn("measuring time", "s", of=duration),
    )
    caption = (
        f"Periods and time that each design needs for σ = {100 * comparison.precision:g} % of "
        f"{_whose(comparison)}, measured at {comparison.sampling:g} Hz"
    )
    if np.any(hopeless):
        left_out = ", ".join(np.array(designs[0].names)[hopeless])
        caption += (
            f"; without {left_out}, which no design identifies in its experiment: fix it, or give "
            "a prior"
        )
    return ReportTable.of("effort", caption, columns)


def _hopeless(comparison: DesignComparison) -> Mask:
    """Return the parameters that no design identifies in the common experiment, (m,)."""
    samples = comparison.experiment_samples
    shares = [_relative_std(design, samples) for design in comparison.designs]
    return np.all([~(share <= IDENTIFIABLE) for share in shares], axis=0)


def _effort(design: ComparedDesign, periods: Array) -> tuple[Value, Value, str, Value]:
    """Return median and largest number of periods, the parameter that decides, and the time, s."""
    if not np.any(np.isfinite(periods)):
        return None, None, "–", None
    worst = int(np.nanargmax(periods))
    most = float(periods[worst])
    return float(np.nanmedian(periods)), most, design.names[worst], most * design.period


def _whose(comparison: DesignComparison) -> str:
    return "the nominal value" if comparison.same_nominal else "its own robot's nominal value"


def _limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    """Return the used share of every limit, one column per design."""
    checks = {design.label: design.result.checks for design in designs}
    titles = {check.key: check.title for own in checks.values() for check in own}
    columns = [TableColumn("limit", kind="text", of=titles.get)]
    for label, own in checks.items():
        used = {check.key: check.used for check in own}
        columns.append(TableColumn(label, "%", of=used.get, factor=100))
    return ReportTable.of("compared_limits", "Used share of every limit", columns, titles)
