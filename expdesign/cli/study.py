"""The stage `study` of a run: a comparison on the digital twin, in a run folder."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import refuse_unwritable
from expdesign.cli.output import messages, results, short, warn_all
from expdesign.cli.simulate import design_doubts, design_to_execute, trajectory_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimation.montecarlo import StudyMonitor
    from estimation.studies import Claim, Study
    from expdesign.configuration import RunConfiguration
    from expdesign.trajectory import FourierTrajectory

STAGE = "study"


def study_stage(configuration: RunConfiguration, folder: Path, *, as_json: bool) -> dict[str, Any]:
    """Do the study, write the run folder, say what came out and return it for machines.

    Raises
    ------
    InputError
        The design is missing or none, or the run cannot be designed, simulated or estimated.
    CommandFailed
        Interrupted, workers died, or something could not be designed or estimated.
    """
    from expdesign.cli.counting import StudyDisplay
    from expdesign.cli.stages import clear_outdated, record_stage
    from results import comparison_study_figures

    trajectory, made_from = None, study_design(folder)
    if needs_design(configuration):
        found = design_to_execute(folder, None)
        warn_all(design_doubts(configuration, found))
        trajectory, made_from = found.trajectory, trajectory_text(found)
    refuse_unwritable(folder)
    began = time.perf_counter()
    display = StudyDisplay(messages(), "steps of the study")
    with record_stage(STAGE, configuration, folder, made_from) as stage:
        with display.shown():
            study = _computed(configuration, trajectory, display)
        clear_outdated(STAGE, configuration, folder, made_from)
        stage.files = [
            *study.write(folder),
            *comparison_study_figures(study, folder, configuration.run.report.figures),
        ]
        stage.status = "done"
        found_claims = study.record.summary.claims
        stage.message = counted(found_claims)
    if not as_json:
        _show(found_claims, folder)
    return {
        "folder": str(folder),
        "claims": [asdict(claim) for claim in found_claims],
        "seconds": time.perf_counter() - began,
    }


def needs_design(configuration: RunConfiguration) -> bool:
    """Tell whether the study executes a design that is there already."""
    section = configuration.run.study
    return section is not None and section.kind != "design"


def study_design(folder: Path) -> str:
    """Return what a study is made from beside the configuration: the folder's design, if any."""
    from expdesign.cli.simulate import folder_design

    return folder_design(folder) if (folder / "design.json").is_file() else ""


def counted(found: Sequence[Claim]) -> str:
    """Return how many claims hold."""
    judged = [claim for claim in found if claim.holds is not None]
    return f"{sum(bool(claim.holds) for claim in judged)} of {len(judged)} claims hold"


def _computed(
    configuration: RunConfiguration, trajectory: FourierTrajectory | None, monitor: StudyMonitor
) -> Study:
    from estimation.estimators import UnidentifiableError
    from estimation.kinematics.fourier_fit import MotionFitError
    from estimation.studies import StudyInterruptedError, TooFewEstimatesError, run_study
    from expdesign.information.fisher import SingularInformationError
    from expdesign.solver import InfeasibleLimitsError, NoDesignError
    from expdesign.workers import WorkerDiedError

    try:
        return run_study(configuration, trajectory, monitor)
    except (
        UnidentifiableError,
        MotionFitError,
        TooFewEstimatesError,
        StudyInterruptedError,
        SingularInformationError,
        InfeasibleLimitsError,
        NoDesignError,
        WorkerDiedError,
    ) as error:
        raise CommandFailed(str(error)) from error


def _show(found: Sequence[Claim], folder: Path) -> None:
    from rich.table import Table

    console = results()
    table = Table(title="On the digital twin (simulated)", title_justify="left")
    table.add_column("what")
    table.add_column("found")
    table.add_column("paper")
    table.add_column("holds")
    for claim in found:
        holds = {True: "yes", False: "no", None: ""}[claim.holds]
        table.add_row(claim.statement, claim.value, claim.paper, holds)
    console.print(table)
    console.print(f"{counted(found)}; written to {short(folder)}")
