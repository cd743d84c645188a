"""What an ended process has left half done: names that tell whose it is, and its removal."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import secrets
import shutil
import sys
import time
from pathlib import Path

_FORGOTTEN = 24 * 3600.0
"""s. What nobody has touched for a day is nobody's, whatever its name says: files are written in
seconds."""

_TOKEN = secrets.token_hex(4)
"""Of this process: another one may get its number later."""
_NAME = re.compile(
    r"\.expdesign-(?P<place>[0-9a-f]{8})-(?P<process>[0-9]{1,10})-(?P<token>[0-9a-f]{8})-"
)


def temporary_prefix() -> str:
    """Return how names of temporary files and folders of this process begin."""
    return f".expdesign-{_place()}-{os.getpid()}-{_TOKEN}-"


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files and folders in a folder whose process has ended.

    Those of a process that lives stay, and those of other computers until they are a day old.
    What cannot be removed stays, too.
    """
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            name = _NAME.match(entry.name)
            if name is None or not _is_left(name, entry.stat(follow_symlinks=False).st_mtime):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    Path(entry.path).unlink()


def _is_left(name: re.Match[str], touched: float) -> bool:
    if time.time() - touched > _FORGOTTEN:
        return True
    if name["place"] != _place():
        return False
    process = int(name["process"])
    if process == os.getpid():
        return name["token"] != _TOKEN
    return not _is_alive(process)


def _place() -> str:
    """Return where numbers of processes mean something: this computer, or container of it."""
    with contextlib.suppress(OSError):
        numbers = Path("/proc/self/ns/pid").readlink()
        return hashlib.sha256(f"{platform.node()} {numbers}".encode()).hexdigest()[:8]
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _is_alive(process: int) -> bool:
    """Tell whether there is a process of this number; when in doubt there is."""
    if sys.platform == "win32":
        return _is_alive_on_windows(process)
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _is_alive_on_windows(process: int) -> bool:
    import ctypes  # noqa: PLC0415 - what is called there is nowhere else

    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    synchronise, running, denied = 0x00100000, 0x102, 5
    handle = kernel.OpenProcess(synchronise, False, process)
    if not handle:
        return bool(kernel.GetLastError() == denied)
    try:
        return bool(kernel.WaitForSingleObject(handle, 0) == running)
    finally:
        kernel.CloseHandle(handle)
