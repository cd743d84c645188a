"""One writer of a run folder: a lock that names its holder, and reads that notice a writer.

The lock is that of the operating system (`flock`), which also works between the computers of an NFS
share and ends with its process, however that ends. A file system without it gets a marker with the
process instead. Both are those of the library filelock.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, ClassVar

from filelock import FileLock, Timeout

from expdesign.configuration import ComputationError, InputError
from expdesign.configuration.several_runs import MOTION
from expdesign.interruption import clean_up
from expdesign.runfolder.fields import described
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.manifest import Manifest, known_hash, text_hash
from expdesign.runfolder.store import JsonFile

LOCK = ".expdesign-lock"
DESIGNS = "designs"
"""Folder of the run folders of a sweep, which belong to its own."""
_PATIENCE, _POLL = 1.0, 0.05
"""s. A holder that just ends releases its lock within this time."""


@dataclass(frozen=True)
class Holder(JsonFile):
    """The command that writes to a folder."""

    FILE: ClassVar[str] = ".expdesign-lock.json"
    WRITTEN_BY: ClassVar[str] = "the command that writes to the folder"
    command: Annotated[str, described("", "name of the command")]
    process: Annotated[int, described("1", "number of the process")]
    computer: Annotated[str, described("", "its name")]
    since: Annotated[str, described("", "beginning, UTC in ISO 8601")]


@contextmanager
def one_writer(folder: Path, command: str) -> Iterator[None]:
    """Hold the lock of a run folder; create the folder, and remove it again if it stays empty.

    The lock of a process that died is free, that of another command is refused. The run folders of
    a sweep's designs and of the motions of one run are locked together with the folder around them.

    Examples
    --------
    >>> import tempfile
    >>> place = Path(tempfile.mkdtemp())
    >>> with one_writer(place / "run", "expdesign run"):
    ...     Holder.read(place / "run").command
    'expdesign run'
    >>> list(place.iterdir())
    []
    """
    with ExitStack() as held:
        for place in _whole_runs(folder):
            held.enter_context(_locked(place, command))
        yield


def _whole_runs(folder: Path) -> tuple[Path, ...]:
    """Return the run folders around a run folder of a sweep or of several motions, and itself."""
    around = folder.parent.parent if folder.parent.name == DESIGNS else folder.parent
    is_part = folder.parent.name == DESIGNS or folder.name.startswith(MOTION)
    if is_part and (around / RUN_FILE).is_file():
        return (*_whole_runs(around), folder)
    return (folder,)


@contextmanager
def one_writer_to(
    place: Path, command: str, source: Path | None, name: str = ""
) -> Iterator[AbstractContextManager[None]]:
    """Hold the lock of the run folder that contains a folder; outside of any, of the folder itself.

    Outside of run folders others may write other files than `name`. It provides the context in
    which the run folder `source` is read: another command may write to it, unless its lock is held.
    """
    source = None if source is None else source.resolve()
    # A folder of the run folder may be a link out of it; with `..` only the real path counts.
    named = () if ".." in place.parts else (place, *place.parents)
    real = place.resolve()
    folders = (one.resolve() for one in (*named, real, *real.parents))
    owner = next((p for p in folders if p == source or (p / Manifest.FILE).is_file()), None)
    alone = _locked(place, command, f"-{text_hash(name)[:8]}" if name else "")
    with alone if owner is None else one_writer(owner, command):
        yield nullcontext() if source in (None, owner) else consistent_reading(source)


@contextmanager
def _locked(folder: Path, command: str, suffix: str = "") -> Iterator[None]:
    created = [place for place in (folder, *folder.parents) if not place.exists()]
    file, holder = (folder / f"{LOCK}{suffix}{ending}" for ending in ("", ".json"))
    lock = FileLock(file, timeout=_PATIENCE, poll_interval=_POLL)

    def release() -> None:
        if lock.is_locked:
            _release(lock, holder, file)
        for place in created:
            with suppress(OSError):
                place.rmdir()

    with clean_up(release):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire()
        except Timeout:
            allowed = "wait until it has ended, or use another folder"
            raise InputError(_who_writes(holder), folder, allowed=allowed) from None
        since = datetime.now(UTC).isoformat(timespec="seconds")
        Holder(command, os.getpid(), platform.node(), since).write_as(holder)
        yield


def _release(lock: FileLock, *files: Path) -> None:
    """Release a lock and remove its files.

    They are removed while it is held: a process that has opened them by now opens new ones.
    """
    for file in files:
        with suppress(OSError):
            file.unlink()
    lock.release()


def _who_writes(file: Path) -> str:
    holder = Holder.known(file)
    if holder is None:
        return "another command is writing to this folder"
    return (
        f"`{holder.command}`, process {holder.process} on {holder.computer}, has been writing to "
        f"this folder since {holder.since}"
    )


def is_empty(folder: Path) -> bool:
    """Return whether a folder has no files but those of its lock."""
    return not folder.is_dir() or {path.name for path in folder.iterdir()} <= {LOCK, Holder.FILE}


@contextmanager
def consistent_reading(*folders: Path) -> Iterator[None]:
    """Fail if another command writes to a folder, or has written before the end of this context.

    A command writes its manifest last; in between it holds the lock.
    """
    before = [_manifest_if_unlocked(folder) for folder in folders]
    yield
    for folder, digest in zip(folders, before, strict=True):
        if digest != _manifest_if_unlocked(folder):
            raise ComputationError(
                f"{folder} was changed by another command while it was read: run it again"
            )


def _manifest_if_unlocked(folder: Path) -> str:
    """Return the hash of a folder's manifest; refuse a folder that another command writes to."""
    file, holder = folder / LOCK, folder / Holder.FILE
    if file.exists():
        lock = FileLock(file, timeout=0)
        with suppress(OSError):
            try:
                lock.acquire()
            except Timeout:
                message = f"{folder}: {_who_writes(holder)}; run it again when that has ended"
                raise ComputationError(message) from None
            _release(lock, holder, file)
    return known_hash(folder / Manifest.FILE)
