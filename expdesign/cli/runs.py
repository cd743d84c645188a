"""Commands on runs: stages, reports and comparisons, with their results on the terminal."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from expdesign.cli.output import note, results, say, warn, write_json
from expdesign.cli.terminal import Terminal, working
from expdesign.configuration import InputError, RunConfiguration, load_run, quote
from expdesign.configuration.consistency import identification_of
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.lock import one_writer
from expdesign.stages.execution import (
    SEARCHES,
    current_configuration,
    execute,
    keep_search,
    refuse_run_file,
    refuse_unwritable,
    run_folder,
    workspaces,
)
from expdesign.stages.registry import FIRST, reported_stages, stage_of, stages
from expdesign.stages.run import folder_changes, refuse_unfit_goals, report_of, run
from expdesign.stages.stage import Sources, StageFailed, Workspace, short
from expdesign.workers import prepare_workers
from results.render.terminal import print_view


def execute_stage(
    name: str,
    config: str,
    out: Path | None,
    as_json: bool,
    *,
    sources: Mapping[str, Any] | None = None,
    strict: bool = False,
    repetitions: int | None = None,
    wanted: Sequence[str] = (),
    resume: bool = False,
    effort: str | None = None,
    seed: int | None = None,
    command: str = "",
) -> None:
    """Execute one stage of a run; the sources replace the inputs that the folder holds."""
    configuration = load_run(config)
    if name == FIRST:
        _prepare_search()
    folder = run_folder(configuration, out)
    refuse_unwritable(folder)
    with one_writer(folder, f"expdesign {command or name}"):
        configuration = current_configuration(configuration, folder).with_search(effort, seed)
        if name not in SEARCHES:
            configuration = keep_search(configuration, folder)
        before = configuration.warnings_before(name)
        if repetitions is not None:
            configuration = configuration.with_section("montecarlo", repetitions=repetitions)
        if name == "goals":
            configuration = _with_goals(configuration, goals_from_texts(wanted))
        inputs = Sources(**(sources or {}))
        work = Workspace(
            configuration, folder, Terminal(quiet=as_json), inputs, resume, stages=reported_stages()
        )
        work.warn(before)
        stage = stage_of(name, configuration)
        if stage.makes_design and not (inputs.designs or work.design_file.is_file()):
            execute(stages()[FIRST], work)
        outcomes = [execute(stage, place) for place in workspaces(stage, work)]
        if name == FIRST and "report" in configuration.run.stages:
            report = stages()["report"]
            for place in workspaces(report, work):
                execute(report, place)
    outcome = outcomes[-1]
    if strict and outcome.doubt:
        raise StageFailed(f"{outcome.doubt}, and --strict was given", outcome.summary)
    if as_json:
        several = {"motions": [one.summary for one in outcomes]}
        write_json({"status": 0, **(outcome.summary if len(outcomes) == 1 else several)})


def _prepare_search() -> None:
    """Start importing what workers of a search need, while this process imports its own modules."""
    if (os.cpu_count() or 1) > 1:
        prepare_workers(partial(import_module, "expdesign.experiment.setup"))


def design_next(
    folders: Sequence[Path],
    out: Path | None,
    as_json: bool,
    *,
    design: Path | None,
    resume: bool,
    effort: str | None,
    seed: int | None,
) -> None:
    """Design the motion after the estimates of run folders; compare it with the last one."""
    from expdesign.experiment.next_motion import executed_designs, next_run

    places = [folder.absolute() for folder in folders]
    configuration = next_run(places, design).with_search(effort, seed)
    folder = run_folder(configuration, out)
    if folder in places:
        message = "the new motion would replace one that was measured"
        raise InputError(message, folder, key="--out", allowed="another folder")
    refuse_unwritable(folder)
    with one_writer(folder, "expdesign next"):
        executed = [design] if design else executed_designs(places[-1])
        inputs = Sources(designs=tuple(executed or places)[-1:])
        terminal = Terminal(quiet=as_json)
        counted = [identification_of(one).run for one in configuration.run.design.priors]
        terminal.note(f"earlier recordings that count: those of {', '.join(counted)}")
        work = Workspace(configuration, folder, terminal, inputs, resume, stages=reported_stages())
        work.design()  # refused before the search if there is none
        work.warn(configuration.warnings_before(FIRST))
        execute(stages()[FIRST], work)
        outcome = execute(stages()["next"], work)
        if "report" in configuration.run.stages:
            execute(stages()["report"], work)
    if as_json:
        write_json({"status": 0, **outcome.summary})


def run_all(
    config: str,
    out: Path | None,
    as_json: bool,
    *,
    resume: bool,
    effort: str | None = None,
    seed: int | None = None,
) -> None:
    """Do every stage that a run names."""
    configuration = load_run(config)
    _prepare_search()
    terminal = Terminal(quiet=as_json)
    made = run(configuration, out, terminal, resume=resume, effort=effort, seed=seed)
    if as_json:
        outcomes = made.stages
        write_json(
            {
                "status": 0,
                "folder": str(made.folder),
                "resumed": all(outcome.kept for outcome in outcomes.values()),
                "stages": {n: {"resumed": o.kept, **o.summary} for n, o in outcomes.items()},
            }
        )


def write_report(folder: Path, as_json: bool) -> None:
    """Write the report of a run folder."""
    place = folder.absolute()
    if place.is_dir():
        refuse_unwritable(place)
        warn_of_changes(place)
    else:
        refuse_run_file(folder)
    with working("report"):
        outcome = report_of(place)
    if as_json:
        write_json({"status": 0, **outcome.summary})
    else:
        say(f"report: {short(outcome.result)}")


def compare_folders(
    folders: Sequence[Path], out: Path, precision: str, *, quick: bool, as_json: bool
) -> None:
    """Write the comparison of run folders."""
    from results.comparison.comparison import write_comparison

    share = precision_share(precision)
    place = out.absolute()
    refuse_unwritable(place)
    paths = [folder.absolute() for folder in folders]
    for path in paths:
        warn_of_changes(path, short(path))
    if not quick and not as_json and any((path / "design.json").is_file() for path in paths):
        note("one solve per design for the costs of its limits (--quick leaves them out) …")
    with working("compare"), one_writer(place, "expdesign compare"):
        written, views = write_comparison(
            paths, place, reported_stages(), precision=share, quick=quick
        )
    if as_json:
        write_json(
            {
                "status": 0,
                "folder": str(place),
                "report": str(place / "report.html"),
                "files": [str(path.relative_to(place)) for path in written],
            }
        )
    else:
        for view in views:
            print_view(view, results())
        say(f"comparison: {short(place / 'report.html')}")


def precision_share(text: str) -> float:
    """Return a relative precision.

    Examples
    --------
    >>> precision_share("1 %"), precision_share("0.01")
    (0.01, 0.01)
    """
    number = text.strip().removesuffix("%")
    try:
        share = float(number) / (100 if number != text.strip() else 1)
    except ValueError:
        share = float("nan")
    if not 0 < share <= 1:
        message = f"'{text}' is not a relative precision"
        allowed = "above 0 and at most 100 %, e.g. 1% or 0.01"
        raise InputError(message, key="--precision", allowed=allowed)
    return share


def _with_goals(configuration: RunConfiguration, wanted: Mapping[str, str]) -> RunConfiguration:
    """Return a run with further goals, all of them checked before a design is searched for."""
    refuse_unfit_goals(configuration, wanted)
    refuse_unfit_goals(configuration)
    goals = {**configuration.run.goals, **wanted}
    return replace(configuration, run=configuration.run.model_copy(update={"goals": goals}))


def goals_from_texts(wanted: Sequence[str]) -> dict[str, str]:
    """Return the goals of ``--want NAME=VALUE``.

    Examples
    --------
    >>> goals_from_texts(["mass=1%", "centre=5mm"])
    {'mass': '1%', 'centre': '5mm'}
    """
    found: dict[str, str] = {}
    for text in wanted:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise InputError(
                f"{quote(text)} is no goal", key="--want", allowed="NAME=VALUE, such as mass=1%"
            )
        found[name] = value
    return found


def warn_of_changes(folder: Path, label: str = "", *stages: str) -> None:
    """Warn of changes by hand in a run folder, of those of some stages or of all."""
    if (folder / RUN_FILE).is_file():
        for change in folder_changes(folder, run_configuration(folder), *stages):
            warn(f"{label}: {change}" if label else change)


def run_configuration(folder: Path) -> RunConfiguration:
    """Return the configuration of a run folder."""
    file = folder / "run.yaml"
    if not file.is_file():
        message = "not a run folder: run.yaml is missing"
        allowed = "a folder that `expdesign design` or `expdesign run` wrote"
        raise InputError(message, folder, key="DIR", allowed=allowed)
    return load_run(file)
