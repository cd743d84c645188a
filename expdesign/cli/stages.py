"""Stages of a run: recorded in the manifest, skipped when they are done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.runfolder.manifest import Manifest, entry, text_hash


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
    yield stage
    manifest = _manifest(configuration, folder)
    seconds = time.perf_counter() - began
    record = entry(
        stage.status,
        stage_inputs(name, configuration),
        seconds,
        stage.message,
        folder,
        stage.files,
    )
    manifest.with_stage(name, record).write(folder)


def is_done(name: str, configuration: RunConfiguration, folder: Path) -> bool:
    """Tell whether a stage was done from this configuration, with its files still in place."""
    manifest = Manifest.read(folder)
    return manifest is not None and manifest.is_done(
        name, stage_inputs(name, configuration), folder
    )


def stage_inputs(name: str, configuration: RunConfiguration) -> str:
    """Return the hash of what a stage is made from: its sections and the versions."""
    manifest = Manifest.new({})
    return text_hash(name, resolved_yaml(configuration), sorted(manifest.versions.items()))


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
