"""Views of simulated experiments: a recording of the digital twin, and a Monte-Carlo study."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from estimation.montecarlo.result import EstimatorStatistics, MonteCarloResult
from estimation.twin.truth import Truth
from results.figures.studies import STUDY_FIGURES
from results.notation import count_text, percent, readable
from results.views.folder import RunFolder
from results.views.parameter_blocks import symbols_blocks
from results.views.view import (
    Block,
    Fact,
    Facts,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    drawings,
)


def experiment_view(folder: RunFolder) -> StageView:
    """Return the view of the simulated recording in a folder."""
    truth = folder.result(Truth)
    experiment = truth.experiment
    disturbances = ", ".join(truth.disturbed_by) or "none"
    twin, executed = "the digital twin", truth.table
    controller: tuple[Fact, ...] = ()
    if executed is not None:
        twin += f" executing {executed.file}"
        how = (
            f"{executed.format}, measured from {executed.window[0]:.4f} s after its start; struts "
            f"within {1e6 * executed.position_error:.2g} µm of the design"
        )
        controller = (Fact("controller table", executed.file, how),)
    if truth.machine is not None:
        twin += f", a machine ({truth.machine.name}) that is not the robot of the run"
    rate, periods = f"{readable(experiment.sampling)} Hz", f"{experiment.periods:g}"
    period = f"{readable(truth.executed.period, 5)} s"
    files = len(list(folder.path.glob("repetitions/*/measurement.csv")))
    times = f", {files} times" if files else ""
    sentence = (
        f"Simulated on {twin}: {periods} periods of {period} measured at {rate}{times}: "
        f"{experiment.samples} samples, {readable(experiment.samples_per_period, 6)} per period. "
        f"Disturbances except the noise: {disturbances}."
    )
    entry = folder.entry("experiment")
    level, word = Level.NEUTRAL, "simulated"
    if entry is not None and entry.status != "done":
        level, word = Level.BAD, entry.status
    verdict = StageVerdict("Experiment", level, word, sentence, "experiment")
    facts = (Fact("samples", f"{experiment.samples}", f"simulated, {periods} periods"),)
    details = Facts(
        (
            Fact("periods", periods),
            Fact("sampling", rate),
            Fact("period", period),
            *controller,
            *((Fact("true machine", truth.machine.name),) if truth.machine else ()),
            Fact("disturbances", disturbances),
            Fact("noise", truth.memory),
            Fact("seed", str(truth.seeds.experiment)),
        ),
        screen=True,
    )
    force, length = (np.sqrt(np.diag(c)) for c in (truth.force_covariance, truth.length_covariance))
    columns = (
        TableColumn("strut", of=range(1, len(force) + 1)),
        TableColumn("force noise σ", "N", of=force),
        TableColumn("length noise σ", "mm", of=length, factor=1e3),
    )
    noise = ReportTable.of("true_noise", "True noise of one sample", columns)
    return StageView(verdict, (details, noise), facts)


def montecarlo_view(folder: RunFolder) -> StageView:
    """Return the view of the study in a folder."""
    result = folder.result(MonteCarloResult)
    summary, estimators = result, result.estimators
    failures = sum(len(entry.failures) for entry in estimators.values())
    names = ", ".join(name.upper() for name in estimators)
    identified = f"{len(summary.identified)} of {len(summary.parameters)}"
    experiment = summary.settings["experiment"]
    sentence = (
        f"{count_text(summary.counts.done, 'simulated experiment')} of "
        f"{count_text(experiment['periods'], 'period')} at {experiment['sampling']:g} Hz, "
        f"estimators {names}; {identified} parameters are "
        "identified."
    )
    if summary.interrupted:
        sentence += f" Interrupted: {summary.counts.wanted} were wanted."
    if failures:
        sentence += f" {failures} estimates failed."
    level = Level.BAD if summary.interrupted else Level.CAUTION if failures else Level.GOOD
    word = "interrupted" if summary.interrupted else "done"
    blocks: list[Block] = [_pooled_table(estimators)]
    blocks += drawings(STUDY_FIGURES, result.rows)
    blocks += [_statistics_table(result), *symbols_blocks(summary.parameters, screen=False)]
    verdict = StageVerdict("Monte-Carlo study", level, word, sentence, "montecarlo")
    return StageView(verdict, tuple(blocks), _facts(estimators))


def _facts(estimators: dict[str, EstimatorStatistics]) -> tuple[Fact, ...]:
    name = "ml" if "ml" in estimators else next(iter(estimators), "")
    pooled = estimators[name].pooled if name else None
    if pooled is None:
        return ()
    title = name.upper()
    return (
        Fact(
            f"{title}: RMSE / bound",
            readable(pooled.rmse_over_bound, 3),
            f"pooled; 95 %: {readable(pooled.rmse_over_bound_low, 3)} … "
            f"{readable(pooled.rmse_over_bound_high, 3)}",
        ),
        Fact(f"{title}: coverage", percent(pooled.coverage), "of its 95 % intervals"),
    )


def _pooled_table(estimators: dict[str, EstimatorStatistics]) -> ReportTable:
    def pooled(key: str) -> Callable[[str], float | None]:
        return lambda name: getattr(estimators[name].pooled, key, None)

    columns = (
        TableColumn("estimator", kind="text", of=lambda name: name.upper()),
        TableColumn("estimates", of=lambda name: estimators[name].estimates),
        TableColumn("failed", of=lambda name: len(estimators[name].failures)),
        TableColumn("RMSE / bound", of=pooled("rmse_over_bound")),
        TableColumn("95 % from", of=pooled("rmse_over_bound_low")),
        TableColumn("95 % to", of=pooled("rmse_over_bound_high")),
        TableColumn("coverage", of=pooled("coverage")),
        TableColumn("95 % from", of=pooled("coverage_low")),
        TableColumn("95 % to", of=pooled("coverage_high")),
        TableColumn("largest bias / its error", digits=3, of=pooled("largest_bias_t")),
    )
    caption = "All identified parameters together"
    return ReportTable.of("montecarlo_pooled", caption, columns, estimators, screen=True)


def _statistics_table(result: MonteCarloResult) -> ReportTable:
    columns = (
        TableColumn("estimator", kind="text", of=lambda row: row.estimator.upper()),
        TableColumn("parameter", kind="parameter", of="parameter"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("truth", of="truth"),
        TableColumn("bias", digits=3, of="bias"),
        TableColumn("bias / its error", digits=3, of="bias_t"),
        TableColumn("spread", digits=3, of="spread"),
        TableColumn("RMSE", digits=3, of="rmse"),
        TableColumn("bound", digits=3, of="bound"),
        TableColumn("RMSE / bound", digits=3, of="rmse_over_bound"),
        TableColumn("coverage", digits=3, of="coverage"),
    )
    caption = "Every estimator and parameter against the truth"
    return ReportTable.of("montecarlo", caption, columns, result.rows, folded=True, latex=True)


def compare_montecarlo(folders: Mapping[str, RunFolder], *_: object) -> StageView:
    """Return the achieved standard deviations of Monte-Carlo studies."""
    found = {label: folder.result(MonteCarloResult).rows for label, folder in folders.items()}
    keys = dict.fromkeys((row.parameter, row.unit) for rows in found.values() for row in rows)
    columns = [
        TableColumn("parameter", kind="parameter", of=[parameter for parameter, _ in keys]),
        TableColumn("unit", kind="text", of=[unit for _, unit in keys]),
    ]
    for label, rows in found.items():
        bounds = {(row.parameter, row.unit): row.bound for row in rows}
        columns.append(
            TableColumn(f"bound, {label}", digits=3, of=[bounds.get(key) for key in keys])
        )
        for estimator in dict.fromkeys(row.estimator for row in rows):
            own = [row for row in rows if row.estimator == estimator]
            spread = {(row.parameter, row.unit): row.spread for row in own}
            title = f"{estimator.upper()}, {label}"
            columns.append(TableColumn(title, digits=3, of=[spread.get(key) for key in keys]))
    caption = (
        "Standard deviations that the estimators achieved in simulated experiments, and the "
        "Cramér–Rao bound of each, SI units"
    )
    table = ReportTable.of("achieved", caption, columns)
    symbols = symbols_blocks((parameter for parameter, _ in keys), screen=False)
    number = count_text(len(folders), "study", "studies")
    sentence = f"{number}: achieved standard deviations and the bound."
    title = "Monte-Carlo studies"
    verdict = StageVerdict(title, Level.NEUTRAL, "compared", sentence, "studies")
    return StageView(verdict, (table, *symbols))
