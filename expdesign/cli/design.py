"""`expdesign design`: the optimal excitation trajectory of a run, in its run folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import (
    JsonOption,
    RunArgument,
    messages,
    results,
    short,
    warn_all,
    write_json,
)

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration
    from expdesign.experiment import DesignResult


def design(run: RunArgument, out: OutOption = None, as_json: JsonOption = False) -> None:
    """Design the optimal excitation trajectory.

    Writes the resolved configuration, design.json, trajectory.csv, tables and figures. Ctrl-C
    ends the search and keeps the best so far, marked.
    """
    from expdesign.configuration import load_run

    configuration = load_run(run)
    warn_all(configuration.warnings)
    summary = design_stage(configuration, run_folder(configuration, out), as_json=as_json)
    if as_json:
        write_json({"status": 0, **summary})


def design_stage(configuration: RunConfiguration, folder: Path, *, as_json: bool) -> dict[str, Any]:
    """Design, write the run folder, say what came out and return it for machines.

    Raises
    ------
    CommandFailed
        No design, an interrupted one, or one that breaks a limit.
    """
    from expdesign.cli.stages import record_stage
    from expdesign.experiment import DesignRecord
    from expdesign.experiment import design as compute
    from results import design_figures

    refuse_unwritable(folder)
    display = _display(configuration)
    with record_stage("design", configuration, folder) as stage:
        with display.shown():
            result = _computed(compute, configuration, display)
        record = DesignRecord.of(result)
        stage.files = [*record.write(folder), *design_figures(record, folder)]
        stage.status = "done" if result.passed else result.status
        stage.message = result.status_text
    summary = _summary(result, folder)
    warn_all(result.warnings[len(configuration.warnings) :])
    if not result.passed:
        raise CommandFailed(_what_is_wrong(result, folder), summary)
    if not as_json:
        _show(result, folder)
    return summary


def _computed(compute: Any, configuration: RunConfiguration, display: Any) -> DesignResult:
    from expdesign.information.fisher import SingularInformationError
    from expdesign.solver import InfeasibleLimitsError, NoDesignError
    from expdesign.workers import WorkerDiedError

    try:
        result: DesignResult = compute(configuration, display)
    except SingularInformationError as error:
        raise CommandFailed(
            f"the limits do not let these parameters be excited: {error.combinations}. Leave "
            f"{', '.join(error.unexcited)} out of design.parameters, or widen speed, acceleration "
            "or workspace.",
            {
                "unexcited": list(error.unexcited),
                "not_told_from": {d.name: list(d.others) for d in error.directions},
            },
        ) from error
    except (InfeasibleLimitsError, NoDesignError, WorkerDiedError) as error:
        raise CommandFailed(str(error)) from error
    return result


def _display(configuration: RunConfiguration) -> Any:
    from expdesign.cli.live import Objective, SearchDisplay
    from expdesign.information.catalogue import criteria_by_key

    section = configuration.run.design
    criterion = criteria_by_key()[section.criterion]
    # The blunt stage of a criterion that is flat far off is that of log det F.
    blunt = criteria_by_key()["d"] if criterion.flat else criterion
    total = section.starts + (section.hops if section.search == "hopping" else 0)
    objective = Objective(criterion.title, blunt.title, criterion.larger_is_better)
    return SearchDisplay(messages(), objective, total)


def _summary(result: DesignResult, folder: Path) -> dict[str, Any]:
    return {
        "folder": str(folder),
        "design_status": result.status,
        "log_det_information": result.log_det_information,
        "criterion": result.configuration.run.design.criterion,
        "criterion_value": result.criterion_value,
        "worst_violation": result.check.worst,
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }


def _what_is_wrong(result: DesignResult, folder: Path) -> str:
    from expdesign.configuration import quantity_text
    from expdesign.recheck import TOLERANCE

    if result.status == "interrupted":
        return f"interrupted: the best so far is saved, and marked, in {short(folder)}"
    broken = [check for check in result.check.limits if check.violation > TOLERANCE]
    parts = []
    for check in sorted(broken, key=lambda check: -check.violation):
        row = f"{check.row}: " if check.row else ""
        parts.append(
            f"{check.key} ({row}{quantity_text(check.value, check.unit)} at {check.time:.4g} s, "
            f"bound {quantity_text(check.bound, check.unit)}, {check.violation:.2g} of its range)"
        )
    return f"the design breaks {'; '.join(parts)}. It is saved, and marked, in {short(folder)}"


def _show(result: DesignResult, folder: Path) -> None:
    from rich import box
    from rich.table import Table

    from constraints import limit_definitions
    from expdesign.configuration import quantity_text

    console = results()
    console.print(_headline(result), soft_wrap=True)
    limits = Table(
        title="Limits over the whole period (unsmoothed model)",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
    )
    for head in ("limit", "where", "worst", "bound", "used"):
        limits.add_column(
            head, justify="left" if head in {"limit", "where"} else "right", no_wrap=True
        )
    for check in result.check.limits:
        used = limit_definitions()[check.key].share_used(check.value, check.bound, check.violation)
        limits.add_row(
            check.key,
            check.row,
            quantity_text(check.value, check.unit, 5),
            quantity_text(check.bound, check.unit, 5),
            f"{100 * used:.1f} %",
        )
    console.print(limits)
    console.print(f"written to {short(folder)}", soft_wrap=True)


def _headline(result: DesignResult) -> str:
    """Return how the design ended, with the value of its own criterion first."""
    from expdesign.information.catalogue import criteria_by_key

    section = result.configuration.run.design
    criterion = criteria_by_key()[section.criterion]
    scaling = {"si": "SI units", "nominal": "nominal scaling"}[section.scaling]
    value = f"{criterion.title} = {result.criterion_value:.7g}"
    if not criterion.invariant:
        value += f" ({scaling}), log det F = {result.log_det_information:.7g}"
    return (
        f"{result.configuration.run.name}: {result.status} in {result.seconds:.0f} s. {value} over "
        f"{result.samples} samples of one period of {result.trajectory.period:.4f} s, from start "
        f"{result.search.best.index}."
    )
