"""`expdesign validate`: the prediction of motions that were not used for the estimate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.errors import CommandFailed
from expdesign.cli.estimate import StrictOption
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import JsonOption, RunArgument, results, short, warn_all, write_json

if TYPE_CHECKING:
    from estimation.validation import ValidationResult
    from expdesign.configuration import RunConfiguration

STAGE = "validate"

EstimateOption = Annotated[
    Path | None,
    typer.Option(
        "--estimate",
        metavar="DIR",
        help="The folder with the estimate.json to predict with; the run folder by default.",
    ),
]


def validate(
    run: RunArgument,
    estimate: EstimateOption = None,
    out: OutOption = None,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare measured with predicted forces on the motions that the run file names.

    Computed motions are measured on the digital twin, recorded ones read from their files. Writes
    validation.json, tables and figures.
    """
    from expdesign.configuration import load_run

    configuration = load_run(run)
    warn_all(configuration.warnings)
    folder = run_folder(configuration, out)
    summary = validate_stage(configuration, folder, estimate=estimate, as_json=as_json)
    if strict and not summary["accepted"]:
        raise CommandFailed(
            "a motion speaks against the model, and --strict was asked for", summary
        )
    if as_json:
        write_json({"status": 0, **summary})


def validate_stage(
    configuration: RunConfiguration,
    folder: Path,
    *,
    estimate: Path | None = None,
    as_json: bool,
) -> dict[str, Any]:
    """Validate, write the run folder, say what came out and return it for machines."""
    from estimation.kinematics.fourier_fit import MotionFitError
    from estimation.validation import read_estimate
    from estimation.validation import validate as compute
    from estimation.validation.output import write_validation
    from expdesign.cli.stages import record_stage
    from expdesign.robot import robot_from
    from results import validation_figures

    source = folder if estimate is None else estimate.absolute()
    saved = read_estimate(source, robot_from(configuration.robot))
    refuse_unwritable(folder)
    with record_stage(STAGE, configuration, folder, folder_estimate(source)) as stage:
        try:
            result = compute(configuration, saved)
        except MotionFitError as error:
            raise CommandFailed(str(error)) from error
        stage.files = write_validation(result, folder)
        stage.files += validation_figures(result, folder)
        stage.status = "done"
        stage.message = "accepted" if result.accepted else "doubtful"
    warn_all(result.warnings[len(configuration.warnings) :])
    if not as_json:
        _show(result, folder)
    return {
        "folder": str(folder),
        "accepted": result.accepted,
        "motions": {motion.name: motion.diagnosis.verdict.summary for motion in result.motions},
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }


def folder_estimate(folder: Path) -> str:
    """Return what a validation is made from beside the configuration: the estimate."""
    from expdesign.runfolder.manifest import file_hash

    path = folder / "estimate.json" if folder.is_dir() else folder
    return file_hash(path) if path.is_file() else ""


def _show(result: ValidationResult, folder: Path) -> None:
    from rich.table import Table

    from estimation.validation.output import validation_table

    console = results()
    table = Table(
        title="Variance of single samples [N²]: about the prediction, and of the noise",
        title_justify="left",
    )
    for head in ("motion", "actuator", "prediction", "noise", "F", "verdict"):
        table.add_column(head, justify="left" if head in {"motion", "verdict"} else "right")
    for row in validation_table(result).itertuples():
        table.add_row(
            row.motion,
            str(row.actuator),
            f"{row.variance_model_error:.1f}",
            f"{row.variance_measurement_error:.1f}",
            f"{row.statistic:.3f}",
            row.verdict,
        )
    console.print(table)
    for motion in result.motions:
        console.print(f"{motion.name}: {motion.diagnosis.verdict.summary}", soft_wrap=True)
        for finding in motion.diagnosis.verdict.failed:
            advice = f"; {finding.advice}" if finding.advice else ""
            console.print(f"- {finding.sentence}{advice}", soft_wrap=True)
    console.print(f"written to {short(folder)}")
