"""One digit changed in every file of a run folder, and every command that may read it.

A command *says* so if it or its page names the file more often than without a change, or *refuses*
the folder with exit status 2. The change is *harmless* if exit status and all written files are
those of the unchanged folder, without doubt if the file is *not read*. Anything else is a finding:
*silent*. The files are those of a run with every stage, with a table and a control model that were
added by hand, and of a sweep; of figures, LaTeX tables and designs of the sweep one stands for all.
Results are changed together, and so are tables, figures and recordings; a file that is neither
named nor harmless among them is changed alone.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from types import MappingProxyType
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
_ONE_OF = (".svg", ".tex", ".py")
"""Endings of files of one kind: the first of a folder stands for all."""
_ALONE = ("columns.json", "design.json", "exports.json", "manifest.json", "run.yaml", "sweep.json")
"""Files that are changed one by one; results are changed together, and so are all others."""
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
            for files in trial.files(folder):
                outcomes = {name: trial.judge(files, line) for name, line in commands.items()}
                left = dict.fromkeys((*_COMMANDS, *_OF_A_SWEEP), "–")
                for file in files:
                    yield {"file": file, **left, **{n: each[file] for n, each in outcomes.items()}}


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

    def files(self, folder: str) -> list[list[str]]:
        """Return the files of a folder, one for all of a kind, in groups changed together."""
        found = dict[str, list[str]]()
        kinds = set[tuple[Path, str]]()
        for path in sorted((self.template / folder).rglob("*")):
            name = path.relative_to(self.template)
            kind = (name.parent, path.suffix)
            left_out = "periods-4" in name.parts or (path.suffix in _ONE_OF and kind in kinds)
            if path.is_file() and not left_out:
                kinds.add(kind)
                results = path.suffix in (".json", ".yaml")
                group = str(name) if path.name in _ALONE else "results" if results else "others"
                found.setdefault(group, []).append(str(name))
        return list(found.values())

    def judge(self, changed: list[str], line: str) -> dict[str, str]:
        """Return the outcome of a command for each of the files that were changed together."""
        if line not in self.unchanged:
            self.unchanged[line] = self._outcome(line)
        known_status, known, known_files, opened = self.unchanged[line]
        found = dict.fromkeys(changed, "not read")
        read = [file for file in changed if file in opened]
        if not read:
            return found
        most = {Path(file).name: known.count(Path(file).name) for file in read}
        status, said, files, _ = self._outcome(line, read, most)
        keys = (files.keys() | known_files) - set(read)
        same = all(files.get(key) == known_files.get(key) for key in keys)
        for file in read:
            name = Path(file).name
            if said.count(name) > most[name]:
                found[file] = "refused" if status == 2 else "said"  # noqa: PLR2004
            elif _mentions(file, files) > _mentions(file, known_files):
                found[file] = "said"
            elif len(read) > 1 and not (same and status == known_status):
                found |= self.judge([file], line)
            elif status not in (0, 1, 2) or "Traceback" in said:
                found[file] = f"exit status {status}"
            else:
                found[file] = "harmless" if same and status == known_status else "silent"
        return found

    def _outcome(
        self, line: str, changed: Sequence[str] = (), most: Mapping[str, int] = MappingProxyType({})
    ) -> tuple[int, str, dict[str, Any], set[str]]:
        """Return exit status, output, files and opened files of a command in a copy of the folders.

        The command ends as soon as it names every changed file more than `most` times.
        """
        folder = self.place / "copy"  # every copy has the same path, which some files contain
        shutil.copytree(self.template, folder)
        for file in changed:
            change_digit(folder / file)
        opened = os.memfd_create("opened")

        def trace(event: str, arguments: tuple[Any, ...]) -> None:
            if event == "open" and not isinstance(arguments[0], int):
                path = os.path.realpath(os.fsdecode(arguments[0]))
                os.write(opened, f"{path}\n".encode())

        made = CopiedRun(line.split(), folder, prepare=lambda: sys.addaudithook(trace))
        while made.is_running():
            time.sleep(0.1)
            text = made.said()
            if most and all(text.count(name) > times for name, times in most.items()):
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


def _mentions(file: str, files: dict[str, Any]) -> int:
    """Return how often the pages among files name a file."""
    pages = (text for name, text in files.items() if name.endswith(".html"))
    return sum(page.count(Path(file).name.encode()) for page in pages)


def change_digit(path: Path) -> None:
    """Change the last digit of a file, or its middle byte."""
    content = bytearray(path.read_bytes())
    digits = [place for place, byte in enumerate(content) if chr(byte).isdigit()]
    place = digits[-1] if digits else len(content) // 2
    content[place] = ord("7") if content[place] != ord("7") else ord("3")
    path.write_bytes(content)
