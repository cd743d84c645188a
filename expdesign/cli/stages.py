"""Stages of a run: recorded in the manifest, skipped when they are done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from expdesign.cli.errors import CommandFailed
from expdesign.configuration import RunConfiguration
from expdesign.runfolder.manifest import Manifest, entry, text_hash

_SECTIONS = {"design": ("name", "robot", "trajectory", "design", "experiment")}
"""Sections of the run that each stage depends on."""


@dataclass
class Stage:
    """What a stage says of itself while it runs."""

    status: str = "failed"
    message: str = ""
    files: list[Path] = field(default_factory=list)


@contextmanager
def record_stage(name: str, configuration: RunConfiguration, folder: Path) -> Iterator[Stage]:
    """Run a stage and write its entry to the manifest, if it wrote any files."""
    began = time.perf_counter()
    stage = Stage()
    try:
        yield stage
    except CommandFailed as failure:
        stage.status, stage.message, stage.files = "failed", failure.message, []
        # Files of an earlier run stay, but the manifest no longer vouches for them.
        if folder.is_dir():
            _write(name, configuration, folder, stage, began)
        raise
    _write(name, configuration, folder, stage, began)


def _write(
    name: str, configuration: RunConfiguration, folder: Path, stage: Stage, began: float
) -> None:
    seconds = time.perf_counter() - began
    inputs = stage_inputs(name, configuration)
    record = entry(stage.status, inputs, seconds, stage.message, folder, stage.files)
    _manifest(configuration, folder).with_stage(name, record).write(folder)


def is_done(name: str, configuration: RunConfiguration, folder: Path) -> bool:
    """Tell whether a stage was done from this configuration, with its files still in place."""
    manifest = Manifest.read(folder)
    return manifest is not None and manifest.is_done(
        name, stage_inputs(name, configuration), folder
    )


def stage_inputs(name: str, configuration: RunConfiguration) -> str:
    """Return the hash of what a stage is made from: its sections and the versions."""
    sections = configuration.run.model_dump_json(include=set(_SECTIONS[name]))
    return text_hash(name, sections, sorted(Manifest.new({}).versions.items()))


def _manifest(configuration: RunConfiguration, folder: Path) -> Manifest:
    run = configuration.run
    fresh = Manifest.new(
        {
            "design": run.design.seed,
            "experiment": run.experiment.seed,
            "montecarlo": run.montecarlo.seed,
        }
    )
    known = Manifest.read(folder)
    if known is None or known.versions != fresh.versions or known.seeds != fresh.seeds:
        return fresh
    return known
