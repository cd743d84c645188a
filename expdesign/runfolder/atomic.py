"""Files that are complete or absent: written beside their place, then renamed."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pandas as pd

from expdesign.runfolder.leftovers import remove_leftovers, temporary_prefix


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Give a temporary path in the folder of `path`; rename it to `path` when all went well.

    What a process that was killed has left there is removed.

    Raises
    ------
    OSError
        It cannot be written; `filename` is that of `path`.
    """
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(path.parent)
        handle, name = tempfile.mkstemp(prefix=temporary_prefix(), dir=path.parent)
        os.close(handle)
        beside = Path(name)
        try:
            yield beside
            # mkstemp makes files that only the owner reads; results are ordinary files.
            beside.chmod(0o666 & ~_umask())
            beside.replace(path)
        except BaseException:
            with suppress(OSError):
                beside.unlink()
            raise


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an error of the system name the file that is being written, not what stands for it."""
    try:
        yield
    except OSError as error:
        name = error.filename
        if error.errno is None:
            raise
        if name is not None and path.parent not in Path(os.fsdecode(name)).parents:
            raise  # of another file, which was read meanwhile
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def write_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8."""
    with written_beside(path) as beside:
        beside.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Any) -> None:
    """Write JSON; numbers that JSON does not have (NaN, ±inf) become null."""
    write_text(path, json.dumps(plain(data), indent=2, ensure_ascii=False) + "\n")


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table with all digits of its numbers (`repr`), comma-separated."""
    with written_beside(path) as beside:
        table.to_csv(beside, index=False, lineterminator="\n")


def plain(data: Any) -> Any:
    """Return arrays as lists, and numbers that JSON does not have (NaN, ±inf) as None."""
    if isinstance(data, dict):
        return {str(key): plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [plain(item) for item in data]
    if hasattr(data, "tolist"):
        return plain(data.tolist())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
