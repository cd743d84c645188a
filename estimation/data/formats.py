"""Formats of recordings, read by their libraries; every failure is bad input.

SciPy's reader of MATLAB files, HDF5, asammdf and rosbags trust the sizes and addresses in a file:
one wrong byte may crash the reading process or exhaust its memory. They read in a separate
process.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimation.data.stamps import count_from_first
from estimation.data.table import FileContent, RawTable, RecordedColumn
from expdesign.configuration import DataSection, InputError

_LONGEST_REASON = 200
_SECONDS = 60.0
_SECONDS_PER_MEGABYTE = 1.0
_MEGABYTE = 1_000_000
_MEMORY = 8_000 * _MEGABYTE
_MEMORY_PER_BYTE = 50
_MOST_MEMORY = 16_000 * _MEGABYTE
_COMMAND = f"from {__name__} import serve; serve()"


@dataclass(frozen=True)
class FileFormat:
    """Format of recordings, declared in :mod:`estimation.data.readers`."""

    title: str
    """Name in messages and in the documentation."""
    extensions: tuple[str, ...]
    """Lower case, with the dot."""
    read: Callable[[Path, DataSection], RawTable]
    """``read(path, section)`` lists the columns of the file, picks those of the channels with
    :func:`estimation.data.table.pick_columns`, and loads them, the time also as integers. Any
    exception except `InputError` counts as a damaged file."""
    library: str | None = None
    extra: str | None = None
    """Optional library, and its extra: ``pip install expdesign[extra]``."""
    may_crash: bool = False
    """True for a library that may crash on damaged files: it runs in a separate process, to which
    the functions are passed by name."""
    accepts: Callable[[Path], bool] | None = None
    """``accepts(path)``, for formats with a common extension."""
    list_columns: Callable[[Path], FileContent] | None = None
    """``list_columns(path)`` returns all columns, for :mod:`estimation.data.guess`."""
    folder_file: str = ""
    """File that identifies a folder of this format; empty if folders are not read."""

    def claims(self, path: Path) -> bool:
        """Return whether an existing file or folder has this format."""
        if path.is_dir():
            return bool(self.folder_file) and (path / self.folder_file).is_file()
        known = path.suffix.lower() in self.extensions
        return known and (self.accepts is None or self.accepts(path))

    def load(self, path: Path, section: DataSection) -> RawTable:
        """Read a file with the format's library.

        Raises
        ------
        InputError
            The file cannot be read, is damaged, or does not have the columns.
        RuntimeError
            The reading process could not be started.
        """
        table: RawTable = self._answer(path, section)
        return table

    def columns_of(self, path: Path) -> FileContent:
        """Return all columns of a file; exceptions as of `load`."""
        if self.list_columns is None:
            known = "name the columns under data.columns"
            raise InputError(f"columns of {self.title} cannot be listed", path, allowed=known)
        content: FileContent = self._answer(path, None)
        return content

    def _answer(self, path: Path, section: DataSection | None) -> Any:
        return (self._load_apart if self.may_crash else self.load_here)(path, section)

    def load_here(self, path: Path, section: DataSection | None) -> RawTable | FileContent:
        """Read a file in this process; without a section, list its columns."""
        with self._named_failures(path):
            if section is None:
                return FileContent(()) if self.list_columns is None else self.list_columns(path)
            table = self.read(path, section)
        if section.sampling is not None and "t" not in table.values:
            stamps = np.arange(max(map(len, table.values.values()))) / section.sampling
            column = RecordedColumn("t", unit="s")
            values, columns = {"t": stamps, **table.values}, {"t": column, **table.columns}
            table = replace(table, values=values, columns=columns)
        count = len(table.values["t"])
        time = table.column_name("t")
        uneven = [
            table.problem(f"the column has {len(values)} samples, '{time}' has {count}", channel)
            for channel, values in table.values.items()
            if len(values) != count
        ]
        if uneven:
            raise InputError(uneven)
        if table.origin:
            return table
        relative, origin = count_from_first(table.values["t"])
        return replace(table, values={**table.values, "t": relative}, origin=origin)

    def _load_apart(self, path: Path, section: DataSection | None) -> Any:
        """Return the table of a section, or without a section all columns."""
        size = _bytes_of(path)
        folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
        try:
            child = subprocess.run(
                [sys.executable, "-P", "-c", _COMMAND],
                input=pickle.dumps((self, path, section)),
                capture_output=True,
                env={**os.environ, "PYTHONPATH": folders, "OPENBLAS_NUM_THREADS": "1"},
                timeout=_SECONDS + _SECONDS_PER_MEGABYTE * size / _MEGABYTE,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise self._damaged(path, "reading does not end") from None
        if child.returncode < 0:
            name = signal.Signals(-child.returncode).name
            raise self._damaged(path, f"its library crashed ({name})")
        if child.returncode > 0:
            raise RuntimeError(f"reading {path} failed: {child.stderr.decode(errors='replace')}")
        answer = pickle.loads(child.stdout)  # our own process wrote it
        if isinstance(answer, InputError):
            raise answer
        return answer

    @contextmanager
    def _named_failures(self, path: Path) -> Iterator[None]:
        """Turn every failure of the library into bad input."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # they are for the library's developers
                yield
        except InputError:
            raise
        except FileNotFoundError:
            raise InputError("there is no such file", path) from None
        except PermissionError:
            raise InputError("there is no permission to read it", path) from None
        except Exception as error:  # noqa: BLE001 - the libraries raise anything on damaged files
            said = " ".join(str(error).split())[:_LONGEST_REASON]
            reason = "".join(mark if mark.isprintable() else "?" for mark in said)
            raise self._damaged(path, reason or type(error).__name__) from None

    def _damaged(self, path: Path, reason: str) -> InputError:
        message = f"the file is damaged or not of the format {self.title}: {reason}"
        return InputError(message, path)


def _bytes_of(path: Path) -> int:
    return sum(p.stat().st_size for p in (path.iterdir() if path.is_dir() else [path]))


def serve() -> None:
    """Serve as the separate process: read a pickle from standard input, write one to output."""
    answers = os.dup(1)
    os.dup2(2, 1)  # output of a library is not part of the answer
    file_format, path, section = pickle.load(sys.stdin.buffer)
    # A damaged size may request any amount.
    limit = min(_MEMORY + _MEMORY_PER_BYTE * _bytes_of(path), _MOST_MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        answer: RawTable | FileContent | InputError = file_format.load_here(path, section)
    except InputError as error:
        answer = error
    with os.fdopen(answers, "wb") as stream:
        pickle.dump(answer, stream)
