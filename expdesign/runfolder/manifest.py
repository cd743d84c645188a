"""`manifest.json`: what made a run folder, which stages are done and from what."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, ClassVar

from expdesign.configuration import RunConfiguration
from expdesign.runfolder.fields import described
from expdesign.runfolder.files import RUN_FILE, json_values
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
    files. `made_from` has a hash of every input by its path, of `run.yaml` that of the sections
    that the stage depends on.
    """

    status: str
    inputs: str
    seconds: float
    finished: str
    message: str = ""
    files: dict[str, str] = field(default_factory=dict)
    made_from: dict[str, str] = field(default_factory=dict)


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
    added: Annotated[
        dict[str, str], described("", "SHA-256 of further files, of `expdesign export`")
    ] = field(default_factory=dict)
    run_file: Annotated[str, described("", "SHA-256 of `run.yaml` as it was written")] = ""
    checksum: Annotated[str, described("", "SHA-256 of the other keys")] = ""

    def as_data(self) -> dict[str, Any]:
        """Return the keys of the file and their values, with a new checksum."""
        return super().as_data() | {"checksum": self._checksum()}

    @property
    def is_intact(self) -> bool:
        """Whether the file is as it was written."""
        return self.checksum == self._checksum()

    def _checksum(self) -> str:
        data = json_values(super().as_data())
        return text_hash(json.dumps({**data, "checksum": ""}, sort_keys=True))

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

    def with_added(self, folder: Path, files: Iterable[Path]) -> Manifest:
        """Return the manifest with further files of the folder as they are now."""
        now = {str(file.relative_to(folder)): file_hash(file) for file in files}
        return replace(self, added=self.added | now)

    def _with(self, now: dict[str, str]) -> dict[str, StageEntry]:
        return {
            key: replace(stage, files={file: now.get(file, d) for file, d in stage.files.items()})
            for key, stage in self.stages.items()
        }

    def changed_files(self, folder: Path) -> list[str]:
        """Return the files that are others now than when a stage or command wrote them."""
        known = dict(self.added)
        for entry in self.stages.values():
            known |= entry.files
        return [file for file, digest in known.items() if known_hash(folder / file) != digest]

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


def find_changes(
    folder: Path,
    manifest: Manifest | None,
    stages: Mapping[str, str],
    sections: Mapping[str, str],
) -> dict[str, tuple[str, ...]]:
    """Return the changes in a run folder that none of its commands has made, in sentences.

    Parameters
    ----------
    folder : Path
    manifest : Manifest or None
        That of the folder.
    stages : mapping of str to str
        The file without which the folder does not hold a stage, by the stage's name.
    sections : mapping of str to str
        Hash of the sections of `run.yaml` that a stage depends on, by its name.

    Returns
    -------
    dict
        By stage: files that it wrote and inputs that are others now; under an empty name changes
        of `run.yaml` and `manifest.json`, under ``"shown"`` those of figures and control models,
        which only pages show. Without changes it is empty.
    """
    if manifest is None:
        return {"": (f"there is no usable {Manifest.FILE}: changes by hand are not known",)}
    found: dict[str, list[str]] = {"": []}
    if not manifest.is_intact:
        found[""].append(f"{Manifest.FILE} was changed by hand")
    if manifest.run_file != known_hash(folder / RUN_FILE):
        found[""].append(f"{RUN_FILE} was changed by hand")
    for name, file in stages.items():
        if not (folder / file).exists():
            continue
        entry = manifest.stages.get(name)
        made = {} if entry is None else entry.files
        if file.startswith(f"{name}s/"):  # exports/, to which `expdesign export` adds
            made = made | manifest.added
        found[name] = [
            f"{written} was changed by hand"
            for written, digest in made.items()
            if known_hash(folder / written) not in ("", digest)
            and not (written.startswith(_SHOWN) or written.endswith(_UNREAD))
        ]
        if file not in made:
            found[name].append(f"{file} was made by hand")
        sources = {} if entry is None else entry.made_from
        found[name] += [
            f"{source} has changed since {file} was made"
            for source, digest in sources.items()
            if source != RUN_FILE and known_hash(folder / source) not in ("", digest)
        ]
        if sources.get(RUN_FILE, sections.get(name)) != sections.get(name):
            found[name].append(f"{RUN_FILE} has changed since {file} was made")
    found["shown"] = [
        f"{file} was changed by hand"
        for file in manifest.changed_files(folder)
        if file.startswith(_SHOWN) and (folder / file).exists()
    ]
    return {name: tuple(texts) for name, texts in found.items() if texts}


_SHOWN = ("figures/", "model/")
_UNREAD = (".tex", "README.txt")
"""Endings of files that no command reads."""


def sections_text(configuration: RunConfiguration, sections: Mapping[str, Any]) -> str:
    """Return sections of the run as JSON."""
    return configuration.run.model_dump_json(include=dict(sections))


def known_hash(path: Path) -> str:
    """Return the SHA-256 of a file; empty for anything else."""
    return file_hash(path) if path.is_file() else ""


def entry(
    status: str,
    inputs: str,
    seconds: float,
    message: str,
    folder: Path,
    files: Iterable[Path],
    made_from: Mapping[str, str] | None = None,
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
        made_from=dict(made_from or {}),
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
