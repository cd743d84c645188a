"""Text files of any kind: read within a bound, and refused in words."""

from __future__ import annotations

import stat
from pathlib import Path

from expdesign.configuration.problem import InputError


def read_text(path: Path, largest: int, allowed: str) -> str:
    """Return the text of a file in UTF-8 of at most `largest` bytes; refuse any other.

    `allowed` is what the file should hold, for messages.
    """
    try:
        if stat.S_ISFIFO(path.stat().st_mode):
            # Opening one waits for whoever may write to it.
            raise InputError("this is a pipe, not a file", path, allowed=allowed)
        with path.open("rb") as stream:
            raw = stream.read(largest + 1)
    except FileNotFoundError:
        raise InputError("there is no such file", path) from None
    except IsADirectoryError:
        raise InputError("this is a folder, not a file", path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {reason}", path) from None
    if b"\0" in raw:
        raise InputError("the file is binary", path, allowed=allowed)
    if len(raw) > largest:
        most = f"{largest // 1024} KiB"
        raise InputError("the file is too large", path, allowed=most)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        raise InputError(message, path, line, allowed=allowed) from None
