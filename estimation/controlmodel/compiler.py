"""The C compiler of this machine, and the self-test of a model that it builds."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from expdesign.configuration import ComputationError
from expdesign.runfolder import described

FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
_NAMES = ("cc", "gcc", "clang")
_PATIENCE = 300.0
"""Seconds that a compiler or a self-test may take."""
_DEVIATION = re.compile(r"^forces +worst deviation ([^\s,]+)", re.MULTILINE)
_TIME = re.compile(r"^forces +median (\S+) us, 99.9 % (\S+) us, worst (\S+) us", re.MULTILINE)


@dataclass(frozen=True)
class SelfTest:
    """Result of a self-test on this computer."""

    precision: Annotated[str, described("", "double or float")]
    compiler: Annotated[str, described("", "that built it, or Python, with its version")]
    deviation: Annotated[float, described("N", "worst deviation of a force from expdesign's")]
    median: Annotated[float | None, described("s", "of the time of a call; null: not measured")]
    most: Annotated[float | None, described("s", "what 99.9 % of the calls take at most")]
    worst: Annotated[
        float | None, described("s", "longest call, with what else the machine was doing")
    ]


def find_compiler() -> str | None:
    """Return the C compiler: that of ``CC``, else cc, gcc or clang; None without any."""
    named = os.environ.get("CC")
    return next(filter(None, map(shutil.which, (named,) if named else _NAMES)), None)


def build(compiler: str, folder: Path, sources: Sequence[str], target: str, *flags: str) -> None:
    """Compile sources of a folder to a file there, without any warning.

    Raises
    ------
    ComputationError
        The compiler refuses.
    """
    command = [compiler, *FLAGS, *flags, "-o", target, *sources, "-lm"]
    done = _run(command, folder)
    if done.returncode:
        raise ComputationError(f"{' '.join(command)} failed: {done.stderr.strip()[-2000:]}")


def run_self_test(command: Sequence[str], folder: Path, precision: str, by: str) -> SelfTest:
    """Run a compiled self-test and return its result.

    Raises
    ------
    ComputationError
        It fails.
    """
    done = _run(command, folder)
    deviation, time = _DEVIATION.search(done.stdout), _TIME.search(done.stdout)
    if done.returncode or deviation is None:
        raise ComputationError(
            f"the self-test of the model ({precision}, {by}) failed: "
            f"{(done.stdout + done.stderr).strip()[-2000:]}"
        )
    times = [None] * 3 if time is None else [1e-6 * float(one) for one in time.groups()]
    return SelfTest(precision, by, float(deviation[1]), *times)


def compiler_name(compiler: str) -> str:
    """Return the first line that a compiler says of itself."""
    said = _run([compiler, "--version"], Path.cwd()).stdout.splitlines()
    return said[0] if said else Path(compiler).name


def _run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PATIENCE,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ComputationError(f"{' '.join(command)} cannot be run: {error}") from error
