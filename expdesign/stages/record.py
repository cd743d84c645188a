"""What the manifest keeps of a stage: what it was made from, what it wrote, whether it is done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.configuration.section import unstated
from expdesign.evaluation.machine_code import evaluator
from expdesign.runfolder.files import RUN_FILE, remove_leftovers, write_text
from expdesign.runfolder.manifest import (
    Manifest,
    StageEntry,
    entry,
    file_hash,
    package_versions,
    text_hash,
)
from expdesign.runfolder.tables import COLUMNS_FILE, tables_described
from expdesign.stages.outcome import Outcome
from expdesign.stages.table import STAGES
from expdesign.stages.workspace import Workspace


def stage_inputs(name: str, work: Workspace) -> str:
    """Return the hash of what a stage is made from: sections of the run, its needs, versions."""
    stage, configuration = STAGES[name], work.configuration
    made_from = " ".join(work.made_from(need) for need in stage.needed(configuration))
    if stage.sections is None:
        # As `run.yaml` states it, which a report shows: with what the run does not name.
        sections = resolved_yaml(configuration)
    else:
        sections = sections_text(configuration, stage.sections)
    return text_hash(name, sections, made_from, sorted(package_versions().items()))


def sections_text(configuration: RunConfiguration, sections: Mapping[str, Any]) -> str:
    """Return sections of the run as JSON, without the keys that it leaves at their default.

    Of those keys, that is, that earlier versions did not have: what such a version did is still
    as it would be done now.
    """
    run = configuration.run
    return run.model_dump_json(include=dict(sections), exclude=unstated(run))


def is_done(name: str, work: Workspace) -> bool:
    """Tell whether a stage was done from the same inputs, with its files still as it wrote them."""
    if not (work.folder / (STAGES[name].result or STAGES[name].record)).is_file():
        return False
    manifest, inputs = Manifest.known(work.folder), work.inputs[name]
    # `columns.json` is of all stages: one that was killed may have added its tables already.
    growing = (COLUMNS_FILE,)
    return (
        manifest is not None
        and manifest.is_done(name, inputs, work.folder, growing=growing)
        and _described(name, manifest.stages[name], work.folder)
    )


def _described(name: str, made: StageEntry, folder: Path) -> bool:
    """Tell whether `columns.json` describes all tables that a stage wrote, if it wrote that."""
    if COLUMNS_FILE not in made.files:
        return True
    described = tables_described(folder)
    return all(
        any(fnmatch(file, table) for table in described)
        for file in made.files
        if any(fnmatch(file, table) for table in STAGES[name].writes if table.endswith(".csv"))
    )


def clear_leftovers(folder: Path) -> None:
    """Remove what a run that was killed has left half written in a run folder."""
    named = [(stage.record, stage.result, *stage.writes) for stage in STAGES.values()]
    places = {str(Path(file).parent) for files in named for file in files}
    for root in (folder, *folder.glob("designs/*")):
        for place in places | {"designs", "montecarlo", "repetitions"}:
            for each in [root] if place == "." else root.glob(place):
                remove_leftovers(each)


def write_entry(work: Workspace, outcome: Outcome, seconds: float) -> None:
    """Write what became of a stage into the manifest.

    The entries of the stages that are not done now stay, unless other versions made them: their
    inputs tell what they belong to.
    """
    run = work.configuration.run
    sections = ((stage, getattr(run, stage, None)) for stage in STAGES)
    seeds = {stage: int(s.seed) for stage, s in sections if s is not None and hasattr(s, "seed")}
    fresh, known = Manifest.new(seeds, evaluator()), Manifest.known(work.folder)
    if known is not None and known.versions == fresh.versions:
        fresh = replace(known, seeds=seeds, evaluation=fresh.evaluation)
    told = () if known is None else known.warnings
    fresh = replace(fresh, warnings=tuple(dict.fromkeys((*told, *work.warned))))
    inputs, message = work.inputs[outcome.stage], outcome.message
    made = entry(outcome.status, inputs, seconds, message, work.folder, outcome.files)
    fresh.with_stage(outcome.stage, made).write(work.folder)


def keep_configuration(configuration: RunConfiguration, folder: Path) -> None:
    """Let `run.yaml` be the configuration that what is in the folder was made from."""
    path, text = folder / RUN_FILE, resolved_yaml(configuration)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)


@contextmanager
def added_to(folder: Path, files: Iterable[Path]) -> Iterator[None]:
    """Add to files of stages, which then have them as they are afterwards.

    What a stage wrote is in there still: no reason to do it again. A file that was not as the
    stage wrote it before, or was gone, stays so.
    """
    before = Manifest.known(folder)
    entries = () if before is None else before.stages.values()
    known = {file: digest for entry in entries for file, digest in entry.files.items()}
    intact = [
        file
        for file in files
        if file.is_file() and known.get(str(file.relative_to(folder))) == file_hash(file)
    ]
    yield
    if before is not None and intact:
        before.with_files(folder, intact).write(folder)


def clear_outdated(name: str, work: Workspace) -> set[Path]:
    """Remove what a stage wrote from other inputs; return what it wrote from the same ones.

    Only files that are as the stage wrote them, and that no other stage wrote too, are removed.
    """
    folder, manifest = work.folder, Manifest.known(work.folder)
    earlier = None if manifest is None else manifest.stages.get(name)
    if manifest is None or earlier is None:
        return set()
    intact = {
        folder / file
        for file, digest in earlier.files.items()
        if (folder / file).resolve().is_relative_to(folder.resolve())
        and (folder / file).is_file()
        and file_hash(folder / file) == digest
    }
    if earlier.inputs == work.inputs[name]:
        return intact
    shared = {
        folder / file for key, e in manifest.stages.items() if key != name for file in e.files
    }
    for path in intact - shared:
        path.unlink()
        if path.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return set()
