"""Programs in a process of their own: for libraries that trust the sizes that stand in a file.

One wrong byte may end the process that reads it, or take all its memory.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_SECONDS = 300
_MEMORY = 4_000_000_000

_LIMITS = f"""
import resource, sys, warnings
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_AS, ({_MEMORY}, {_MEMORY}))
warnings.simplefilter("ignore")
"""


class EndlessError(Exception):
    """The program did not end."""


def output_of(program: str, path: Path) -> bytes | None:
    """Return what a Python program prints of a file, ``sys.argv[1]``; None where it fails.

    It has 4 GB of memory.

    Raises
    ------
    EndlessError
        It does not end within 300 s.
    """
    folders = os.pathsep.join(folder or str(Path.cwd()) for folder in sys.path)
    try:
        child = subprocess.run(
            [sys.executable, "-P", "-c", _LIMITS + program, str(path)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env={**os.environ, "PYTHONPATH": folders, "OPENBLAS_NUM_THREADS": "1"},
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EndlessError from None
    return child.stdout if child.returncode == 0 else None
