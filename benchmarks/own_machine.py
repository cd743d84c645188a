"""The page of one's own machine, walked at full size: from `init` to an identified robot file.

The commands are those of docs/own-machine.md; the run is the one that `init` writes, with five
harmonics, eight starts, and ten periods at 1 kHz.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import shorten
from typing import Any

import pandas as pd

from tests.docs.tutorial import Step, steps

TITLE = "From a drawing to an identified robot file"

Row = dict[str, Any]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "own-machine.md"
LONGEST = 600.0
"""Seconds that the whole page may take."""
_RUN = "press-run.yaml"
_FULL = """\
name: press
robot: press.yaml
trajectory: {harmonics: 5, frequency: [0.12 Hz, 0.6 Hz], samples: 200, controller_period: 1 ms}
design: {starts: 8, search: restarts}
experiment: {periods: 10, sampling: 1 kHz}
"""


def rows() -> Iterator[Row]:
    """Yield what every command took; the last row is the whole."""
    taken = []
    with TemporaryDirectory() as name:
        for step in steps(PAGE):
            seconds, status, said = _done(step, Path(name))
            if step.kind == "command":
                taken.append(seconds)
                yield {
                    "command": _short(step.text),
                    "time": f"{seconds:.0f} s",
                    "exit status": status,
                    "last line": said,
                }
        found = Path(name) / "runs/press-measured/identified-robot.yaml"
        yield {
            "command": f"{len(taken)} commands",
            "time": f"{sum(taken):.0f} s",
            "exit status": "",
            "last line": f"{found.name} is {'there' if found.is_file() else 'missing'}",
        }


def summary(table: pd.DataFrame) -> str:
    """Tell whether the page takes as long as it may."""
    failed = int((table["exit status"].iloc[:-1] != 0).sum())
    total = float(table["time"].iloc[-1].removesuffix(" s"))
    holds = failed == 0 and total <= LONGEST
    return f"{failed} commands failed; under {LONGEST:.0f} s: {'yes' if holds else 'no'}"


def _done(step: Step, folder: Path) -> tuple[float, int, str]:
    """Do a step; return its seconds, its exit status and the last line that it wrote."""
    if step.kind == "file":
        text = _FULL if step.name == _RUN else step.text
        (folder / step.name).write_text(text, encoding="utf-8")
    if step.kind not in ("command", "script"):
        return 0.0, 0, ""
    words = ["-c", step.text]
    if step.kind == "command":
        words = ["-m", *shlex.split(step.text)]
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(PAGE.parents[1])},
    )
    lines = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
    return time.monotonic() - began, done.returncode, lines[-1] if lines else ""


def _short(command: str) -> str:
    return shorten(command, 60, placeholder=" …")
