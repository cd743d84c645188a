"""Execution of a stage in its run folder: the folder's place and checks, files, the manifest."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from fnmatch import fnmatch
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from expdesign.configuration import (
    ComputationError,
    InputError,
    RunConfiguration,
    load_run,
    resolved_yaml,
)
from expdesign.configuration.design import Effort
from expdesign.configuration.several_runs import motion_folders, motion_runs
from expdesign.evaluation.machine_code import evaluator
from expdesign.interruption import clean_up, interruptible
from expdesign.library import run_files
from expdesign.progress import listen_to_progress, report_progress
from expdesign.runfolder.files import RUN_FILE, remove_leftovers, write_text
from expdesign.runfolder.lock import is_empty
from expdesign.runfolder.manifest import (
    Manifest,
    StageEntry,
    entry,
    file_hash,
    known_hash,
    package_versions,
    sections_hash,
    sections_text,
    text_hash,
)
from expdesign.runfolder.tables import COLUMNS_FILE, tables_described
from expdesign.stages.stage import Outcome, Stage, StageFailed, Workspace, short
from expdesign.trajectory import TrajectoryFile
from expdesign.workers import StoppedError, prepare_workers
from results.views.folder import RunFolder
from results.views.view import StageView

Place = str | PathLike[str]

_SAVING = ("the result is saved first", "discards what is not yet saved")
_FOLDERS = ("tables", "figures", "exports", "designs", "montecarlo", "repetitions")
"""Folders of files in a run folder, and in the folders of a sweep's designs."""
SEARCHES = ("design", "motions")
"""Stages that search for motions."""
_PARALLEL = (*SEARCHES, "montecarlo")
"""Stages whose workers are needed soon after their modules are loaded."""


def execute(stage: Stage, work: Workspace) -> Outcome:
    """Do a stage, keep its configuration in the folder and write its entry to the manifest.

    A stage that fails leaves `run.yaml` as it was, since nothing there was made from its
    configuration. Files of an earlier run stay, but the manifest no longer vouches for them. A
    failure, an interruption and a broken limit are a `StageFailed`, after the files are written. A
    `KeyboardInterrupt` comes once the stage is complete, or when nothing of it is kept.
    """
    work.inputs[stage.name] = input_hash(stage, work)
    work.origins[stage.name] = origins(stage, work)
    for warning in changed_inputs(stage, work):
        work.progress.warn(warning)
    refuse_unwritable(work.folder)
    clear_leftovers(work.folder)
    began = time.perf_counter()
    try:
        if stage.name in _PARALLEL and (work.configuration.run.workers or 1) > 1:
            prepare_workers()
        with work.progress.working(stage.name) as listener, listen_to_progress(listener):
            with _entry_if_interrupted(stage, work, began):
                stage.read_inputs(work)
                report_progress("loading modules")
                outcome = stage.functions().run(work)
            # Hours of computation are not lost to a Ctrl-C in the seconds of saving.
            with interruptible(work.progress.note, *_SAVING) as asked:
                outcome = save(outcome, stage, work, began)
    except ComputationError as error:
        stopped = isinstance(error, StoppedError)
        if stopped or not is_empty(work.folder):
            status = "interrupted" if stopped else "failed"
            ended = Outcome(stage.name, work.folder, status=status, message=error.message)
            write_entry(work, ended, time.perf_counter() - began)
        raise StageFailed(error.message, error.details) from error
    work.progress.show(outcome)
    if outcome.failure:
        raise StageFailed(outcome.failure, outcome.summary)
    if outcome.asked_to_stop or asked():
        raise KeyboardInterrupt
    return outcome


@contextmanager
def _entry_if_interrupted(stage: Stage, work: Workspace, began: float) -> Iterator[None]:
    """Write the manifest's entry of a stage that an interruption ends, also during an import."""
    ended = False

    def write_unless_ended() -> None:
        if not ended:
            outcome = Outcome(stage.name, work.folder, status="interrupted", message="no result")
            write_entry(work, outcome, time.perf_counter() - began)

    with clean_up(write_unless_ended):
        try:
            yield
        except Exception:
            ended = True
            raise
        ended = True


def workspaces(stage: Stage, work: Workspace) -> list[Workspace]:
    """Return the workspaces in which a stage is done: that of the run, or those of its motions.

    Given designs and tables are executed for the run as a whole.
    """
    single = len(work.motion_folders) == 1 or stage.motions == "together"
    if single or work.sources.designs or work.sources.table is not None:
        return [work]
    own = motion_workspaces(work)
    return own if stage.motions == "each" else [*own, work]


def motion_workspaces(work: Workspace) -> list[Workspace]:
    """Return the workspaces of the motions of a run."""
    runs = motion_runs(work.configuration, work.folder)
    return [
        Workspace(run, folder, work.progress, work.sources, stages=work.stages)
        for run, folder in zip(runs, work.motion_folders, strict=True)
    ]


def save(outcome: Outcome, stage: Stage, work: Workspace, began: float) -> Outcome:
    """Write the files of an outcome and its entry in the manifest; return it with both."""
    outcome = _write(outcome, stage, work)
    seconds = time.perf_counter() - began
    summary = {"folder": str(work.folder), "seconds": seconds, **outcome.summary}
    outcome = replace(outcome, stage=stage.name, folder=work.folder, summary=summary)
    keep_configuration(work.configuration, work.folder)
    write_entry(work, outcome, seconds)
    for file in outcome.temporary:
        file.unlink(missing_ok=True)
    work.made[stage.name] = outcome
    return outcome


def _write(outcome: Outcome, stage: Stage, work: Workspace) -> Outcome:
    """Write and draw the stored result, unless the stage has written files itself."""
    files = outcome.files
    if not files:
        report_progress("writing the results")
        files = tuple(outcome.result.write(work.folder))
    view = outcome.view or view_result(stage, outcome.result, work)
    if view.drawings:
        # The library that draws takes a second to load; the result is written by now.
        from results.render.figures import draw_figures

        report_progress("drawing figures")
        run = work.configuration.run
        drawn = draw_figures(view, work.folder, run.report.figures, workers=run.workers or 1)
        files = (*files, *drawn)
    return replace(outcome, files=files, view=view)


def view_result(stage: Stage, result: Any, work: Workspace) -> StageView:
    """Return the view of a result in memory."""
    results = {type(result): result}
    stages = {stage.name: stage}
    folder = RunFolder(work.folder, stages, work.configuration, results=results, brief=True)
    return stage.views().view(folder)


def input_hash(stage: Stage, work: Workspace) -> str:
    """Return the hash of the inputs of a stage: sections of the run, results, versions."""
    configuration = work.configuration
    made_from = " ".join(work.made_from(need) for need in stage.inputs(configuration))
    if stage.sections is None:
        # The whole run.yaml, which a report shows, and the changes by hand that it names.
        changes = changes_by_hand(stage, work.folder, own=False)
        sections = "\n".join([resolved_yaml(configuration), *changes])
    else:
        sections = sections_text(configuration, stage.sections)
    return text_hash(stage.name, sections, made_from, sorted(package_versions().items()))


def origins(stage: Stage, work: Workspace) -> dict[str, str]:
    """Return a hash of each input of a stage by its path; of `run.yaml` that of its sections."""
    sections = stage.sections
    found = {} if sections is None else {RUN_FILE: sections_hash(work.configuration, sections)}
    for need in stage.inputs(work.configuration):
        for path in work.input_files(need):
            inside = path.is_relative_to(work.folder)
            name = str(path.relative_to(work.folder) if inside else path)
            found[name] = file_hash(path)
    return found


def changed_inputs(stage: Stage, work: Workspace) -> Iterator[str]:
    """Yield the changes by hand of the files that a stage reads, in sentences.

    A table is read with its description in the same folder. Results in memory are not read.
    """
    for need in stage.inputs(work.configuration):
        for path in work.input_files(need):
            folder = next((p for p in path.parents if (p / Manifest.FILE).is_file()), path.parent)
            manifest = Manifest.known(folder)
            if manifest is None or (folder == work.folder and work.made):
                continue
            own = path.relative_to(folder)
            for file in map(Path, manifest.changed_files(folder)):
                in_place = file.parent == own.parent != Path() and file.suffix == ".json"
                if (file == own or in_place) and (folder / file).exists():
                    yield f"{short(folder / file)} was changed by hand"


def changes_by_hand(stage: Stage, folder: Path, *, own: bool) -> list[str]:
    """Return the changes of the files that a stage wrote, or of all others, in sentences."""
    manifest = Manifest.known(folder)
    if manifest is None:
        return []
    made = manifest.stages.get(stage.name)
    files = set() if made is None else set(made.files)
    changed = set(manifest.changed_files(folder)) - {COLUMNS_FILE}
    found = sorted(changed & files if own else changed - files)
    return [f"{file} was changed by hand" for file in found if (folder / file).exists()]


def is_done(stage: Stage, work: Workspace) -> bool:
    """Return whether a stage was done from the same inputs and its files are unchanged."""
    if not (work.folder / (stage.output or stage.file)).is_file():
        return False
    manifest, inputs = Manifest.known(work.folder), work.inputs[stage.name]
    # `columns.json` belongs to all stages: one that was killed may have added its tables already.
    growing = (COLUMNS_FILE,)
    return (
        manifest is not None
        and manifest.is_done(stage.name, inputs, work.folder, growing=growing)
        and _is_described(stage, manifest.stages[stage.name], work.folder)
    )


def _is_described(stage: Stage, made: StageEntry, folder: Path) -> bool:
    """Return whether `columns.json` describes all tables of a stage, if the stage wrote it."""
    if COLUMNS_FILE not in made.files:
        return True
    described = tables_described(folder)
    return all(
        any(fnmatch(file, table) for table in described)
        for file in made.files
        if any(fnmatch(file, table) for table in stage.writes if table.endswith(".csv"))
    )


def clear_leftovers(folder: Path) -> None:
    """Remove half-written files of a run that was killed; the folder's lock is held."""
    for root in (folder, *folder.glob("designs/*")):
        remove_leftovers(root, locked=True)
        for place in (*_FOLDERS, "repetitions/*"):
            for each in root.glob(place):
                remove_leftovers(each, locked=True)


def write_entry(work: Workspace, outcome: Outcome, seconds: float) -> None:
    """Write the entry of a stage into the manifest.

    The entries of other stages stay, unless other versions made them; each has the hash of its
    inputs.
    """
    seeds = {name: int(s.seed) for name, s in work.configuration.run if hasattr(s, "seed")}
    fresh = Manifest.new(seeds, evaluator())
    known = Manifest.known(work.folder) or fresh
    if known.versions != fresh.versions:
        known = replace(fresh, run_file=known.run_file, warnings=known.warnings)
    inputs, message = work.inputs[outcome.stage], outcome.message
    origin = work.origins.get(outcome.stage, {})
    made = entry(outcome.status, inputs, seconds, message, work.folder, outcome.files, origin)
    warnings = tuple(dict.fromkeys((*known.warnings, *work.warned)))
    found = replace(known, seeds=seeds, evaluation=fresh.evaluation, warnings=warnings)
    if outcome.files:
        found = replace(found, run_file=known_hash(work.folder / RUN_FILE))
    found.with_stage(outcome.stage, made).write(work.folder)


def keep_configuration(configuration: RunConfiguration, folder: Path) -> None:
    """Write the configuration of the folder's results to `run.yaml`."""
    path, text = folder / RUN_FILE, resolved_yaml(configuration)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)
    known, digest = Manifest.known(folder), file_hash(path)
    if known is not None and known.run_file != digest:
        replace(known, run_file=digest).write(folder)


@contextmanager
def add_to_files(folder: Path, files: Iterable[Path]) -> Iterator[None]:
    """Add content to files of stages, and update their hashes in the manifest.

    The stage's own content is still there, so that the stage need not be done again. A file that
    was changed or missing before stays so for the manifest.
    """
    before = Manifest.known(folder)
    known = {} if before is None else before.files
    intact = [one for one in files if known_hash(one) == known.get(str(one.relative_to(folder)))]
    yield
    if before is not None and intact:
        before.with_files(folder, intact).write(folder)


def record_added(
    folder: Path, files: Iterable[Path], made_from: Mapping[Path, Mapping[str, str]]
) -> None:
    """Write files that no stage has written into the manifest, some of them with their inputs."""
    known = Manifest.known(folder)
    if known is not None:
        known.with_added(folder, files, made_from).write(folder)


def clear_outdated(stage: str, work: Workspace) -> set[Path]:
    """Remove files that a stage wrote from other inputs; return those from the same inputs.

    Only unchanged files that no other stage wrote are removed.
    """
    folder, manifest = work.folder, Manifest.known(work.folder)
    earlier = None if manifest is None else manifest.stages.get(stage)
    if manifest is None or earlier is None:
        return set()
    intact = {
        folder / file
        for file, digest in earlier.files.items()
        if (folder / file).resolve().is_relative_to(folder.resolve())
        and known_hash(folder / file) == digest
    }
    if earlier.inputs == work.inputs[stage]:
        return intact
    shared = {
        folder / file for key, e in manifest.stages.items() if key != stage for file in e.files
    }
    for path in intact - shared:
        path.unlink()
        if path.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return set()


_ROOM = 2**20
"""Free bytes that a stage needs at its beginning; most stages write less."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def run_folder(configuration: RunConfiguration, out: Place | None) -> Path:
    """Return the run folder: the given one, or runs/<name> in the current folder."""
    if out is not None and not os.fspath(out):
        raise InputError("the text is empty", key="--out", allowed="the name of a folder")
    return (Path("runs") / configuration.run.name if out is None else Path(out)).absolute()


def current_configuration(configuration: RunConfiguration, folder: Path) -> RunConfiguration:
    """Return the configuration; read that of the folder's own `run.yaml` again, under its lock.

    Another command may have written it meanwhile.
    """
    file = configuration.file
    if file is None or file.absolute() != folder / RUN_FILE:
        return configuration
    return load_run(file)


def keep_search(configuration: RunConfiguration, folder: Path) -> RunConfiguration:
    """Return the run with the size and seed of the search that made the folder's design.

    Options may have given them: the stages after the design would write those of the run file to
    `run.yaml`, and the design would seem to be made from another one.
    """
    file = folder / RUN_FILE
    designs = (each / TrajectoryFile.FILE for each in motion_folders(configuration, folder))
    if configuration.run.sweep or not (file.is_file() and any(map(Path.is_file, designs))):
        return configuration
    made = load_run(file).run.design
    search = {key: getattr(made, key) for key in ("effort", *Effort._fields, "seed")}
    kept = configuration.with_section("design", **search)
    kept.run.model_fields_set.intersection_update(configuration.run.model_fields_set)
    return kept


def refuse_run_file(place: Path) -> None:
    """Refuse a run file, or the name of a run that ships, instead of a run folder."""
    if not (place.is_file() or str(place) in run_files()):
        return
    try:
        folder = run_folder(load_run(str(place) if str(place) in run_files() else place), None)
    except InputError:
        return  # another file: the caller refuses it
    made = "" if folder.is_dir() else ", which does not exist yet"
    message = f"this is a run and not its folder, {short(folder)}{made}"
    raise InputError(message, place, allowed=f"a run folder such as {short(folder)}")


def refuse_unwritable(folder: Path) -> None:
    """Refuse a folder that cannot be written to, before the computation."""
    allowed = "a folder that is new, or may be written to"
    try:
        for place in (folder, *folder.parents):
            if place.is_symlink() and not place.exists():
                raise InputError("the link leads nowhere", place, key="--out", allowed=allowed)
        existing = next(path for path in (folder, *folder.parents) if path.exists())
        with TemporaryFile(dir=existing) as file:
            file.write(bytes(_ROOM))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        if error.errno in _FULL:
            raise OSError(error.errno, os.strerror(error.errno), str(folder)) from error
        message = f"cannot write there: {error.strerror}"
        raise InputError(message, folder, key="--out", allowed=allowed) from error


def refuse_removed(folder: Path, made: Iterable[Outcome]) -> None:
    """Fail when a folder no longer holds the results of its stages."""
    manifest = Manifest.known(folder)
    held = {} if manifest is None else manifest.stages
    gone = [one.stage for one in made if (one.files or one.kept) and one.stage not in held]
    if gone:
        raise StageFailed(
            f"{short(folder)} was removed or emptied during the run: the results of "
            f"{', '.join(gone)} are lost. The same command makes them again."
        )
