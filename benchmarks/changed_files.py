"""One digit changed in every file of a run folder, and every command that may read it.

A command *says* so if it or its page names the file more often than without a change, or *refuses*
the folder with exit status 2. The change is *harmless* if exit status and all written files are
those of the unchanged folder, without doubt if the file is *not read*. Anything else is a finding:
*silent*. The files are those of a
run with every stage, with a table and a control model that were added by hand, and of a sweep; of
figures and LaTeX tables one stands for all.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.folders import quick_robot, timeless_files
from expdesign.cli.app import app, run
from tests.blank_figures import blank_figures
from tests.killed_runs import CopiedRun
from tests.tiny_run import tiny_run

TITLE = "One digit changed in every file of a run folder"

_COMMANDS = {
    "certify": "certify run --json",
    "export": "export run --format csv --file again --json",
    "model": "model run --format python --out away",
    "report": "report run",
    "compare": "compare run beside --quick --out away",
    "simulate": "simulate alone.yaml --design run --out away",
    "simulate --table": "simulate alone.yaml --design run --table run/exports/csv.csv --out away",
    "noise": "noise alone.yaml --data run/measurement.csv --design run --out away",
    "estimate": "estimate alone.yaml --data run/measurement.csv --design run --out away",
    "validate": "validate alone.yaml --estimate run --out away",
    "montecarlo": "montecarlo alone.yaml --design run --out away",
    "run": "run whole.yaml --out run",
}
_OF_A_SWEEP = {"sweep": "run sweep.yaml --out swept", "sweep report": "report swept"}
_ONE_OF = (".svg", ".tex", ".py", ".csv")
"""Endings of files of one kind: in `figures/`, `tables/` and `model/` the first stands for all."""
_DESIGN = {"seed": 0, "smoothing": [0.4], "max_iterations": 4}
_STAGES: dict[str, Any] = {
    "montecarlo": {"repetitions": 2, "estimators": ["ls"]},
    "estimate": {"estimators": ["ls"]},
    "validate": [{"motion": "circle", "periods": 3}],
}
_RUNS: dict[str, dict[str, Any]] = {
    "alone": _STAGES,
    "whole": _STAGES
    | {
        "feedforward": {"bandwidth": "4 Hz"},
        "export": [{"format": "xps-pvt", "segment": 0.02, "tolerance": 2e-4, "scale": 0.3}],
        "report": {"figures": ["svg"]},
    },
    "sweep": {"sweep": {"experiment.periods": [3, 4]}, "report": {"figures": ["svg"]}},
}


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each file, with the outcome of each command."""
    with tempfile.TemporaryDirectory(prefix="expdesign-changed-") as place:
        trial = _Trials(Path(place))
        for folder, commands in (("run", _COMMANDS), ("swept", _OF_A_SWEEP)):
            for file in trial.files(folder):
                outcomes = {name: trial.judge(file, line) for name, line in commands.items()}
                left = dict.fromkeys((*_COMMANDS, *_OF_A_SWEEP), "–")
                yield {"file": file, **left, **outcomes}


def summary(table: pd.DataFrame) -> str:
    """Return the number of silent changes."""
    cells = table.drop(columns="file").stack()
    counts = {
        word: int((cells == word).sum()) for word in ("said", "refused", "harmless", "not read")
    }
    counted = ", ".join(f"{count} {word}" for word, count in counts.items())
    return f"{int((cells == 'silent').sum())} silent changes; {counted}."


class _Trials:
    """Commands on copies of two folders, with the outcome for the unchanged ones."""

    def __init__(self, place: Path) -> None:
        self.place, self.template = place, place / "template"
        self.template.mkdir()
        self.unchanged: dict[str, tuple[int, str, dict[str, Any], set[str]]] = {}
        for name, changes in _RUNS.items():
            made = tiny_run(robot=quick_robot(), design=_DESIGN, **changes)
            file = self.template / f"{name}.yaml"
            file.write_text(json.dumps(made), encoding="utf-8")
        lines = (
            *("run whole.yaml --out run", "noise whole.yaml --out run"),
            *("export run --format csv", "model run --format python", "report run"),
            *("design alone.yaml --out beside", "run sweep.yaml --out swept"),
        )
        with blank_figures(), chdir(self.template):
            for line in lines:
                if run(app, line.split()):
                    raise RuntimeError(f"failed: expdesign {line}")

    def files(self, folder: str) -> list[str]:
        """Return the files of a folder, one for all of a kind."""
        found = list[str]()
        kinds = set[tuple[str, str]]()
        for path in sorted((self.template / folder).rglob("*")):
            name = path.relative_to(self.template)
            kind = (str(name.parent), path.suffix)
            shared = path.suffix in _ONE_OF and name.parts[-2] in ("figures", "python", "tables")
            if path.is_file() and not (shared and path.suffix != ".csv" and kind in kinds):
                found.append(str(name))
            kinds.add(kind)
        return found

    def judge(self, file: str, line: str) -> str:
        """Return the outcome of a command after a change in a file."""
        if line not in self.unchanged:
            self.unchanged[line] = self._outcome(line)
        known_status, known, known_files, opened = self.unchanged[line]
        if file not in opened:
            return "not read"
        most = known.count(Path(file).name)
        status, said, files, _ = self._outcome(line, file, most)
        if said.count(Path(file).name) > most:
            return "refused" if status == 2 else "said"  # noqa: PLR2004
        pages = [text for name, text in files.items() if name.endswith(".html")]
        known_pages = [text for name, text in known_files.items() if name.endswith(".html")]
        if _count(file, pages) > _count(file, known_pages):
            return "said"
        if status not in (0, 1, 2) or "Traceback" in said:
            return f"exit status {status}"
        keys = (files.keys() | known_files) - {file}
        same = all(files.get(key) == known_files.get(key) for key in keys)
        return "harmless" if same and status == known_status else "silent"

    def _outcome(
        self, line: str, changed: str = "", most: int = 0
    ) -> tuple[int, str, dict[str, Any], set[str]]:
        """Return exit status, output, files and opened files of a command in a copy of the folders.

        The command ends as soon as it names the changed file more than `most` times.
        """
        folder = self.place / "copy"  # every copy has the same path, which some files contain
        shutil.copytree(self.template, folder)
        if changed:
            change_digit(folder / changed)
        opened = os.memfd_create("opened")

        def trace(event: str, arguments: tuple[Any, ...]) -> None:
            if event == "open" and not isinstance(arguments[0], int):
                path = os.path.realpath(os.fsdecode(arguments[0]))
                os.write(opened, f"{path}\n".encode())

        made = CopiedRun(line.split(), folder, prepare=lambda: sys.addaudithook(trace))
        while made.is_running():
            time.sleep(0.1)
            if changed and made.said().count(Path(changed).name) > most:
                # Long enough for a refusal to end it.
                time.sleep(1)
                if made.is_running():
                    os.kill(made.process, signal.SIGKILL)
        status, said = made.end()
        files = timeless_files(folder)
        paths = os.pread(opened, 2**24, 0).decode().splitlines()
        os.close(opened)
        shutil.rmtree(folder)
        inside = {str(Path(path).relative_to(folder)) for path in paths if str(folder) in path}
        return status, " ".join(" ".join(said).split()), files, inside


def _count(file: str, pages: list[bytes]) -> int:
    """Return how often pages say that a file was changed."""
    return sum(page.count(f"{Path(file).name} was changed".encode()) for page in pages)


def change_digit(path: Path) -> None:
    """Change the last digit of a file, or its middle byte."""
    content = bytearray(path.read_bytes())
    digits = [place for place, byte in enumerate(content) if chr(byte).isdigit()]
    place = digits[-1] if digits else len(content) // 2
    content[place] = ord("7") if content[place] != ord("7") else ord("3")
    path.write_bytes(content)
