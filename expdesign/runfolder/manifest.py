"""`manifest.json`: what made a run folder, which stages are done and from what."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from fnmatch import fnmatch
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol

from expdesign.configuration import RunConfiguration
from expdesign.runfolder.fields import described
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.store import JsonFile

_PACKAGES = (
    *("expdesign", "casadi", "llvmlite", "numpy", "scipy", "pandas", "matplotlib", "pydantic"),
)


@dataclass(frozen=True)
class StageEntry:
    """Entry of a stage: its status and the time of its end, UTC in ISO 8601.

    Its status is ``"done"``, ``"limits broken"``, ``"not reachable"`` (a goal), ``"incomplete"``
    (parts of it failed), ``"interrupted"`` or ``"failed"``. `files` has the SHA-256 of every file
    that it wrote, by path in the run folder; `inputs` is the hash of its inputs. `run.yaml` is not
    among the files. `made_from` has a hash of every input by its path, of `run.yaml` that of the
    sections that the stage depends on.
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
    added_from: Annotated[
        dict[str, dict[str, str]],
        described("", "`made_from` of tables and control models of these"),
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
        return text_hash(json.dumps({**super().as_data(), "checksum": ""}, sort_keys=True))

    @classmethod
    def new(cls, seeds: dict[str, int], evaluation: str) -> Manifest:
        """Start a manifest with the versions that are installed."""
        return cls(package_versions(), seeds, evaluation, {})

    def with_stage(self, name: str, entry: StageEntry) -> Manifest:
        """Return the manifest with one stage set.

        Where it wrote a file that another stage wrote before (`columns.json`, to which both add),
        the file as it is now counts for both. A file that a command had added is then the stage's.
        """
        return replace(
            self,
            stages={**self._with(entry.files), name: entry},
            added={file: d for file, d in self.added.items() if file not in entry.files},
            added_from={file: d for file, d in self.added_from.items() if file not in entry.files},
        )

    def with_files(self, folder: Path, files: Iterable[Path]) -> Manifest:
        """Return the manifest with these files as they are now, for the stages that wrote them."""
        now = {str(file.relative_to(folder)): file_hash(file) for file in files}
        return replace(self, stages=self._with(now))

    def with_added(
        self, folder: Path, files: Iterable[Path], made_from: Mapping[Path, Mapping[str, str]]
    ) -> Manifest:
        """Return the manifest with further files of the folder, some of them with their inputs."""
        now = {str(file.relative_to(folder)): file_hash(file) for file in files}
        inputs = {str(file.relative_to(folder)): dict(d) for file, d in made_from.items()}
        return replace(self, added=self.added | now, added_from=self.added_from | inputs)

    def _with(self, now: dict[str, str]) -> dict[str, StageEntry]:
        return {
            key: replace(stage, files={file: now.get(file, d) for file, d in stage.files.items()})
            for key, stage in self.stages.items()
        }

    @property
    def files(self) -> dict[str, str]:
        """SHA-256 of all files that stages and commands wrote, by path."""
        written = [entry.files for entry in self.stages.values()]
        return {file: digest for files in (self.added, *written) for file, digest in files.items()}

    def changed_files(self, folder: Path) -> list[str]:
        """Return the files that are others now than when a stage or command wrote them."""
        return [file for file, digest in self.files.items() if known_hash(folder / file) != digest]

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


class WatchedStage(Protocol):
    """A stage, such as `Stage`: its file, patterns of further files, and sections of the run."""

    file: str
    writes: tuple[str, ...]
    sections: Mapping[str, Any] | None


@dataclass(frozen=True)
class FolderChanges:
    """Changes in a run folder that none of its commands has made, in sentences."""

    folder: tuple[str, ...] = ()
    """Of `run.yaml` and `manifest.json`."""
    stages: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Of the files of each stage, such as a table, and of the inputs of each file."""
    pages: tuple[str, ...] = ()
    """Of figures and control models, which only pages show."""

    def of(self, *stages: str) -> tuple[str, ...]:
        """Return the changes of stages."""
        return tuple(text for stage in stages for text in self.stages.get(stage, ()))

    @property
    def all(self) -> tuple[str, ...]:
        """All changes."""
        return tuple(dict.fromkeys((*self.folder, *self.of(*self.stages), *self.pages)))


def find_changes(
    folder: Path,
    manifest: Manifest | None,
    stages: Mapping[str, WatchedStage],
    configuration: RunConfiguration,
) -> FolderChanges:
    """Return the changes in a run folder that none of its commands has made."""
    if manifest is None:
        unknown = (f"there is no usable {Manifest.FILE}: changes by hand are not known",)
        held = (name for name, stage in stages.items() if (folder / stage.file).exists())
        return FolderChanges(unknown, dict.fromkeys(held, unknown))
    own = [] if manifest.is_intact else [f"{Manifest.FILE} was changed by hand"]
    if manifest.run_file != known_hash(folder / RUN_FILE):
        own.append(f"{RUN_FILE} was changed by hand")
    found = {}
    for name, stage in stages.items():
        if not (folder / stage.file).exists():
            continue
        entry = manifest.stages.get(name)
        made = {} if entry is None else dict(entry.files)
        sources = {} if entry is None else {stage.file: entry.made_from}
        for file, digest in manifest.added.items():
            if not any(fnmatch(file, pattern) for pattern in stage.writes):
                continue
            if file in manifest.added_from:
                made[file], sources[file] = digest, manifest.added_from[file]
            else:  # a description, to which the command has added
                made.setdefault(file, digest)
        # No stage and no section of a report reads the others.
        read = {file: d for file, d in made.items() if not file.startswith(_SHOWN)}
        texts = _changed(folder, {file: d for file, d in read.items() if not file.endswith(".tex")})
        if stage.file not in made:
            texts.append(f"{stage.file} was made by hand")
        for file, inputs in sources.items():
            # The stage's own section is not that of a file that a command has added.
            own_section = "" if file == stage.file else name
            sections = sections_hash(configuration, stage.sections, without=own_section)
            texts += _changed_since(folder, file, inputs, sections)
        found[name] = tuple(dict.fromkeys(texts))
    shown = {file: d for file, d in manifest.files.items() if file.startswith(_SHOWN)}
    pages = _changed(folder, shown)
    for file, inputs in manifest.added_from.items():
        if file.startswith(_SHOWN):
            pages += _changed_since(folder, file, inputs, "")
    stages_found = {name: texts for name, texts in found.items() if texts}
    return FolderChanges(tuple(own), stages_found, tuple(pages))


_SHOWN = ("figures/", "model/")


def _changed(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Return the files, with their hashes, that are others now."""
    return [
        f"{file} was changed by hand"
        for file, digest in files.items()
        if known_hash(folder / file) not in ("", digest)
    ]


def _changed_since(
    folder: Path, file: str, inputs: Mapping[str, str], sections: str
) -> Iterator[str]:
    """Yield the inputs of a file that are others now, if the file is there."""
    for source, digest in inputs.items() if (folder / file).exists() else ():
        now = sections if source == RUN_FILE else known_hash(folder / source)
        if now not in ("", digest):
            yield f"{source} has changed since {file} was made"


def sections_text(configuration: RunConfiguration, sections: Mapping[str, Any]) -> str:
    """Return sections of the run as JSON."""
    return configuration.run.model_dump_json(include=dict(sections))


def sections_hash(
    configuration: RunConfiguration, sections: Mapping[str, Any] | None, without: str = ""
) -> str:
    """Return the hash of sections of a run, perhaps without one of them."""
    kept = {name: keys for name, keys in (sections or {}).items() if name != without}
    return text_hash(sections_text(configuration, kept))


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
    return {"python": platform.python_version()} | {one: version(one) for one in _PACKAGES}


@cache
def version(package: str) -> str:
    """Return the version of a package, or `not installed`."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


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
