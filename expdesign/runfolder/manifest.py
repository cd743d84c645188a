"""`manifest.json`: what made a run folder, which stages are done and from what."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, ClassVar

from expdesign.runfolder.fields import described
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.store import JsonFile

_PACKAGES = (
    *("expdesign", "casadi", "llvmlite", "numpy", "scipy", "pandas", "matplotlib", "pydantic"),
)


@dataclass(frozen=True)
class StageEntry:
    """Entry of a stage: its status and the time of its end, UTC in ISO 8601.

    Its status is ``"done"``, ``"limits broken"``, ``"incomplete"`` (parts of it failed),
    ``"interrupted"`` or ``"failed"``. `files` has the SHA-256 of every file that it wrote, by path
    in the run folder; `inputs` is the hash of its inputs. `run.yaml` is not among the
    files.
    """

    status: str
    inputs: str
    seconds: float
    finished: str
    message: str = ""
    files: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest(JsonFile):
    """Versions, seeds and stages of a run."""

    FILE: ClassVar[str] = "manifest.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign run`"
    versions: Annotated[dict[str, str], described("", "of Python and the packages")]
    seeds: Annotated[dict[str, int], described("", "by stage")]
    evaluation: Annotated[str, described("", "evaluator of the graph")]
    stages: Annotated[dict[str, StageEntry], described("", "status of each stage, by name")]
    warnings: Annotated[
        tuple[str, ...], described("", "of robot and run, shown once per folder")
    ] = ()

    @classmethod
    def new(cls, seeds: dict[str, int], evaluation: str) -> Manifest:
        """Start a manifest with the versions that are installed."""
        return cls(package_versions(), seeds, evaluation, {})

    def with_stage(self, name: str, entry: StageEntry) -> Manifest:
        """Return the manifest with one stage set.

        Where it wrote a file that another stage wrote before (`columns.json`, to which both add),
        the file as it is now counts for both.
        """
        return replace(self, stages={**self._with(entry.files), name: entry})

    def with_files(self, folder: Path, files: Iterable[Path]) -> Manifest:
        """Return the manifest with these files as they are now, for the stages that wrote them."""
        now = {str(file.relative_to(folder)): file_hash(file) for file in files}
        return replace(self, stages=self._with(now))

    def _with(self, now: dict[str, str]) -> dict[str, StageEntry]:
        return {
            key: replace(stage, files={file: now.get(file, d) for file, d in stage.files.items()})
            for key, stage in self.stages.items()
        }

    def is_done(
        self, name: str, inputs: str, folder: Path, *, growing: Collection[str] = ()
    ) -> bool:
        """Return whether a stage was done from these inputs and its files are unchanged.

        Files that are `growing` only have to exist.
        """
        entry = self.stages.get(name)
        if entry is None or entry.inputs != inputs or entry.status != "done":
            return False
        return all(
            (folder / file).is_file() and (file in growing or file_hash(folder / file) == digest)
            for file, digest in entry.files.items()
        )


def entry(
    status: str, inputs: str, seconds: float, message: str, folder: Path, files: Iterable[Path]
) -> StageEntry:
    """Return the entry of a stage that ended now and wrote `files`."""
    return StageEntry(
        status=status,
        inputs=inputs,
        seconds=round(seconds, 3),
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        message=message,
        files={
            str(file.relative_to(folder)): file_hash(file)
            for file in sorted(files)
            if file != folder / RUN_FILE
        },
    )


def package_versions() -> dict[str, str]:
    """Return the versions of what a result depends on, as they are installed."""
    versions = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def text_hash(*texts: Any) -> str:
    """Return the SHA-256 of the texts given, in their order."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(str(text).encode())
        digest.update(b"\0")
    return digest.hexdigest()
