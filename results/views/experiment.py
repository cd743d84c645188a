"""View of a simulated recording: the experiment on the digital twin."""

from __future__ import annotations

import numpy as np

from estimation.twin.truth import Truth
from results.notation import readable
from results.views.folder import RunFolder
from results.views.view import Fact, Facts, Level, ReportTable, StageVerdict, StageView, TableColumn


def experiment_view(folder: RunFolder) -> StageView:
    """Return the view of the simulated recording in a folder."""
    truth = folder.result(Truth)
    experiment = truth.experiment
    disturbances = ", ".join(truth.disturbances.active) or "none"
    table = "" if truth.table is None else truth.table.file
    twin = f"the digital twin executing {table}" if table else "the digital twin"
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
            *((Fact("controller table", table, _execution(truth)),) if table else ()),
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


def _execution(truth: Truth) -> str:
    """Return how the controller table was executed; empty without one."""
    table = truth.table
    if table is None:
        return ""
    return (
        f"{table.format}, measured from {table.window[0]:.4f} s after its start; struts within "
        f"{1e6 * table.position_error:.2g} µm of the design"
    )
