"""Reading in a process of its own: compiled readers crash on damaged files, this process must not.

SciPy's reader of MATLAB files, HDF5 and asammdf trust the sizes and addresses that stand in a
file: one wrong byte may end the process that reads it.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import subprocess
import sys
from pathlib import Path

from estimation.data.formats import damaged, load_table
from estimation.data.table import FileFormat, RawTable
from expdesign.configuration import DataSection, InputError

_SECONDS = 60.0
_SECONDS_PER_MEGABYTE = 1.0
_MEGABYTE = 1_000_000
_MEMORY = 8_000 * _MEGABYTE
_MEMORY_PER_BYTE = 50
_COMMAND = f"from {__name__} import serve; serve()"


def load_table_apart(file_format: FileFormat, path: Path, section: DataSection) -> RawTable:
    """Read a file in another process.

    Raises
    ------
    InputError
        As `load_table` has it, and when the process crashes or does not come to an end.
    RuntimeError
        The process could not be started.
    """
    size = path.stat().st_size
    try:
        child = subprocess.run(
            [sys.executable, "-P", "-c", _COMMAND],
            input=pickle.dumps((file_format, path, section)),
            capture_output=True,
            env=_environment(),
            timeout=_SECONDS + _SECONDS_PER_MEGABYTE * size / _MEGABYTE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise damaged(file_format, path, "reading does not end") from None
    if child.returncode < 0:
        name = signal.Signals(-child.returncode).name
        raise damaged(file_format, path, f"its library crashed ({name})")
    if child.returncode > 0:
        raise RuntimeError(f"reading {path} failed: {child.stderr.decode(errors='replace')}")
    answer: RawTable | InputError = pickle.loads(child.stdout)  # our own process wrote it
    if isinstance(answer, InputError):
        raise answer
    return answer


def _environment() -> dict[str, str]:
    """Return the environment in which the other process finds the same modules."""
    folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
    return {**os.environ, "PYTHONPATH": folders, "OPENBLAS_NUM_THREADS": "1"}


def serve() -> None:
    """Be the other process: read what standard input names, write a pickle to standard output."""
    answers = os.dup(1)
    os.dup2(2, 1)  # what a library prints is not part of the answer
    file_format, path, section = pickle.load(sys.stdin.buffer)
    limit = _MEMORY + _MEMORY_PER_BYTE * path.stat().st_size  # a damaged size may ask for any
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        answer: RawTable | InputError = load_table(file_format, path, section)
    except InputError as error:
        answer = error
    with os.fdopen(answers, "wb") as stream:
        pickle.dump(answer, stream)
