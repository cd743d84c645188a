"""Design of the motion after the estimates of run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from expdesign.cli.output import write_json
from expdesign.cli.terminal import Terminal
from expdesign.configuration import InputError
from expdesign.configuration.consistency import identification_of
from expdesign.experiment.next_motion import executed_designs, next_run
from expdesign.information.identifiable import listed
from expdesign.runfolder.lock import one_writer
from expdesign.stages.execution import execute, refuse_unwritable, run_folder
from expdesign.stages.registry import FIRST, reported_stages, stages
from expdesign.stages.stage import Sources, Workspace


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
        terminal.note(f"earlier recordings that count: those of {listed(counted)}")
        work = Workspace(configuration, folder, terminal, inputs, resume, stages=reported_stages())
        work.design()  # refused before the search if there is none
        work.warn(configuration.warnings_before(FIRST))
        execute(stages()[FIRST], work)
        outcome = execute(stages()["next"], work)
        if "report" in configuration.run.stages:
            execute(stages()["report"], work)
    if as_json:
        write_json({"status": 0, **outcome.summary})
