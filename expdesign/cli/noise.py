"""`expdesign noise`: size, distribution and memory of the noise of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from expdesign.cli.estimate import DesignsOption, data_files, made_from, recorded_designs
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import (
    JsonOption,
    RunArgument,
    note,
    results,
    short,
    warn_all,
    write_json,
)

if TYPE_CHECKING:
    from estimation.diagnostics import NoiseAnalysis

STAGE = "noise"

RecordingOption = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="FILE",
        help="A recording of two periods or more; data.file, or the run folder's measurement.csv, "
        "by default.",
    ),
]


def noise(
    run: RunArgument,
    data: RecordingOption = None,
    design: DesignsOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Analyse the noise of measured forces and lengths, without any model.

    Writes noise.json, a table and figures: full covariances with their uncertainty, distributions,
    autocorrelation, drift, outliers.
    """
    from estimation.data.reading import read_measurement
    from estimation.diagnostics import analyse_noise
    from estimation.diagnostics.noise_output import noise_record, write_noise
    from estimation.identification.period_choice import choose_omega
    from estimation.processing import PeriodError, make_record
    from expdesign.cli.stages import record_stage
    from expdesign.configuration import InputError, Problem, load_run
    from results import noise_figures

    configuration = load_run(run)
    warn_all(configuration.warnings)
    folder = run_folder(configuration, out)
    (file,) = data_files(configuration, folder, [] if data is None else [data])
    (trajectory,) = recorded_designs(folder, design or (), 1)
    refuse_unwritable(folder)
    inputs = made_from([file], design or (), folder)
    with record_stage(STAGE, configuration, folder, inputs) as stage:
        recording = read_measurement(file, configuration.run.data, configuration.robot)
        warn_all(recording.warnings)
        omega, source = choose_omega(configuration, recording, trajectory)
        try:
            analysis = analyse_noise(make_record(recording, omega, source))
        except (PeriodError, ValueError) as error:
            raise InputError(
                Problem(str(error), file=file, key="--data", allowed="two periods or more")
            ) from error
        stage.files = write_noise(analysis, str(file), configuration, folder)
        stage.files += noise_figures(analysis, folder, configuration.run.report.figures)
        stage.status = "done"
    if as_json:
        write_json({"status": 0, "folder": str(folder), **noise_record(analysis, str(file))})
        return
    _show(analysis, folder)
    if not analysis.record.averaged:
        note("periods are no whole number of samples: the scatter is that about a Fourier series")


def _show(analysis: NoiseAnalysis, folder: Path) -> None:
    import numpy as np
    from rich.table import Table

    console = results()
    record = analysis.record
    console.print(
        f"{record.rows} rows, {record.periods:.6g} periods of {record.period:.6g} s (from the "
        f"{record.source.value})",
        soft_wrap=True,
    )
    for title, covariance, factor, unit in (
        ("forces", analysis.noise.force_covariance, 1.0, "N"),
        ("lengths", analysis.noise.length_covariance, 1e3, "mm"),
    ):
        std = np.sqrt(np.diag(covariance))
        table = Table(
            title=f"Noise of the {title}: standard deviation [{unit}] and correlation",
            title_justify="left",
        )
        table.add_column("strut")
        table.add_column("std", justify="right")
        for j in range(6):
            table.add_column(str(j + 1), justify="right")
        for i in range(6):
            row = [f"{covariance[i, j] / (std[i] * std[j]):.3f}" for j in range(6)]
            table.add_row(str(i + 1), f"{factor * std[i]:.4g}", *row)
        console.print(table)
    for finding in analysis.findings:
        advice = f"; {finding.advice}" if finding.advice else ""
        console.print(
            f"- {finding.assumption}: {finding.outcome.value}. {finding.sentence}{advice}",
            soft_wrap=True,
        )
    console.print(f"written to {short(folder)}")
