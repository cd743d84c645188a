"""The run folder: its place, and checks that it can be written to and still holds its results."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile

from expdesign.configuration import InputError, RunConfiguration, load_run, quote
from expdesign.library import run_files
from expdesign.runfolder.manifest import Manifest
from expdesign.stages.workspace import Outcome, StageFailed, short

Place = str | PathLike[str]

_ROOM = 2**20
"""Free bytes that a stage needs at its beginning; most stages write less."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

_LONGEST_NAME, _LONGEST_PATH = 255, 3800
"""Bytes of a folder's name, and of its whole path: what systems take, with room for the files."""


def run_folder(configuration: RunConfiguration, out: Place | None) -> Path:
    """Return the run folder: the given one, or runs/<name> in the current folder."""
    if out is not None and not os.fspath(out):
        raise InputError("the text is empty", key="--out", allowed="the name of a folder")
    folder = (Path("runs") / configuration.run.name if out is None else Path(out)).absolute()
    refuse_long(folder)
    return folder


def refuse_long(folder: Path) -> None:
    """Refuse a folder with a name that is too long for the system."""
    longest = max(len(os.fsencode(part)) for part in folder.parts)
    if longest > _LONGEST_NAME or len(os.fsencode(folder)) > _LONGEST_PATH:
        message = f"{quote(folder.name)}: the name is too long"
        named = f"{_LONGEST_NAME} bytes in each name, {_LONGEST_PATH} in all"
        raise InputError(message, key="--out", allowed=named)


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
    refuse_long(folder)
    for place in (folder, *folder.parents):
        if place.is_symlink() and not place.exists():
            raise InputError("the link leads nowhere", place, key="--out", allowed=allowed)
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    try:
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
