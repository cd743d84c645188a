"""Stages of a run: recorded in the manifest, skipped when they are done."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from expdesign.cli.errors import CommandFailed
from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.runfolder.atomic import write_text
from expdesign.runfolder.manifest import RUN_FILE, Manifest, entry, file_hash, text_hash

_SECTIONS: dict[str, dict[str, bool | set[str]]] = {
    "design": {
        **dict.fromkeys(("name", "robot", "trajectory", "design"), True),
        "experiment": {"periods", "sampling"},
    },
    "experiment": dict.fromkeys(("name", "robot", "experiment"), True),
    "noise": dict.fromkeys(("name", "robot", "trajectory", "data"), True),
    "montecarlo": dict.fromkeys(("name", "robot", "experiment", "estimate", "montecarlo"), True),
    "estimate": dict.fromkeys(("name", "robot", "trajectory", "data", "estimate"), True),
    "validate": dict.fromkeys(
        ("name", "robot", "trajectory", "experiment", "data", "estimate", "validation"), True
    ),
    "study": dict.fromkeys(
        (
            "name",
            "robot",
            "trajectory",
            "design",
            "experiment",
            "estimate",
            "montecarlo",
            "study",
        ),
        True,
    ),
    "export": {
        **dict.fromkeys(("name", "robot", "trajectory", "motion", "export"), True),
        "design": {"parameters"},
        "experiment": {"periods", "sampling"},
    },
}
"""Sections of the run, or keys of them, that each stage depends on; any other on all of it."""


@dataclass
class Stage:
    """What a stage says of itself while it runs."""

    status: str = "failed"
    message: str = ""
    files: list[Path] = field(default_factory=list)


@contextmanager
def record_stage(
    name: str, configuration: RunConfiguration, folder: Path, made_from: str = ""
) -> Iterator[Stage]:
    """Run a stage, leave its configuration in the folder and write its entry to the manifest.

    A stage that fails leaves `run.yaml` as it was: nothing there was made from its configuration.

    Parameters
    ----------
    name : str
    configuration : RunConfiguration
    folder : Path
    made_from : str
        What the stage depends on beside its sections of the run.
    """
    began = time.perf_counter()
    stage = Stage()
    inputs = stage_inputs(name, configuration, made_from)
    try:
        yield stage
    except CommandFailed as failure:
        stage.status, stage.message, stage.files = "failed", failure.message, []
        # Files of an earlier run stay, but the manifest no longer vouches for them.
        if folder.is_dir():
            _write(name, configuration, folder, stage, inputs, began)
        raise
    keep_configuration(configuration, folder)
    _write(name, configuration, folder, stage, inputs, began)


def keep_configuration(configuration: RunConfiguration, folder: Path) -> None:
    """Let `run.yaml` be the configuration that what is in the folder was made from."""
    path, text = folder / RUN_FILE, resolved_yaml(configuration)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)


def _write(
    name: str,
    configuration: RunConfiguration,
    folder: Path,
    stage: Stage,
    inputs: str,
    began: float,
) -> None:
    seconds = time.perf_counter() - began
    record = entry(stage.status, inputs, seconds, stage.message, folder, stage.files)
    _manifest(configuration, folder).with_stage(name, record).write(folder)


def is_done(name: str, configuration: RunConfiguration, folder: Path, made_from: str = "") -> bool:
    """Tell whether a stage was done from this configuration, with its files still in place."""
    manifest = Manifest.read(folder)
    return manifest is not None and manifest.is_done(
        name, stage_inputs(name, configuration, made_from), folder
    )


@contextmanager
def added_to(folder: Path, files: Iterable[Path]) -> Iterator[None]:
    """Add to files of stages, which then have them as they are afterwards.

    What a stage wrote is in there still: no reason to do it again. A file that was not as the
    stage wrote it before, or was gone, stays so.
    """
    before = Manifest.read(folder)
    known = (
        {} if before is None else {f: d for e in before.stages.values() for f, d in e.files.items()}
    )
    intact = [
        file
        for file in files
        if file.is_file() and known.get(str(file.relative_to(folder))) == file_hash(file)
    ]
    yield
    if before is not None and intact:
        before.with_files(folder, intact).write(folder)


def clear_outdated(
    name: str, configuration: RunConfiguration, folder: Path, made_from: str = ""
) -> set[Path]:
    """Remove what a stage wrote from other inputs; return what it wrote from the same ones.

    Only files that are as the stage wrote them, and that no other stage wrote too, are removed.
    """
    manifest = Manifest.read(folder)
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
    if earlier.inputs == stage_inputs(name, configuration, made_from):
        return intact
    shared = {
        folder / file for key, e in manifest.stages.items() if key != name for file in e.files
    }
    for path in intact - shared:
        path.unlink()
        if path.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return set()


def stage_inputs(name: str, configuration: RunConfiguration, made_from: str = "") -> str:
    """Return the hash of what a stage is made from: its sections, what else, and the versions."""
    if name in _SECTIONS:
        sections = configuration.run.model_dump_json(include=_SECTIONS[name])
    else:
        # As `run.yaml` states it, which a report shows: with what the run does not name.
        sections = resolved_yaml(configuration)
    return text_hash(name, sections, made_from, sorted(Manifest.new({}).versions.items()))


def _manifest(configuration: RunConfiguration, folder: Path) -> Manifest:
    """Return the folder's manifest with the seeds of this run, a new one for other versions.

    The entries of the stages that are not done now stay: their inputs tell what they belong to.
    """
    run = configuration.run
    fresh = Manifest.new(
        {
            "design": run.design.seed,
            "experiment": run.experiment.seed,
            "montecarlo": run.montecarlo.seed,
        }
    )
    known = Manifest.read(folder)
    if known is None or known.versions != fresh.versions:
        return fresh
    return replace(known, seeds=fresh.seeds)
