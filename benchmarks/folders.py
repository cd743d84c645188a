"""Two commands on one run folder at once: never a folder of both.

Every pair begins with a copy of the same folder and starts its second command 0 to 5 s after the
first. The files at the end are those of one of the two alone, where the other was refused, or of
one after the other. The manifest agrees with every file, and the folder is opened again.
"""

from __future__ import annotations

import json
import random
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import chdir
from io import BytesIO
from pathlib import Path
from typing import Any

import pandas as pd
from ruamel.yaml import YAML

from expdesign.cli.app import app, run
from expdesign.configuration.robot import load_robot_description
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.lock import LOCK
from expdesign.runfolder.manifest import Manifest, known_hash
from expdesign.stages.registry import reported_stages
from results.views.folder import RunFolder
from tests.blank_figures import blank_figures
from tests.killed_runs import CopiedRun, contents
from tests.tiny_run import tiny_run

TITLE = "Two commands on one run folder at once"

_PAIRS = 50
_LONGEST_DELAY = 5.0
"""s, between the starts of two commands."""
_COMMANDS = {
    "run": "run other.yaml --out run",
    "sweep": "run sweep.yaml --out run",
    "design": "design other.yaml --out run",
    "simulate": "simulate other.yaml --out run",
    "noise": "noise other.yaml --out run",
    "estimate": "estimate other.yaml --out run",
    "validate": "validate further.yaml --out run",
    "montecarlo": "montecarlo further.yaml --out run",
    "export": "export run --format csv --file again",
    "export all": "export run",
    "export elsewhere": "export run --format csv --out away/table.csv",
    "model": "model run --format python",
    "model elsewhere": "model run --format python --out away/model",
    "report": "report run",
    "compare": "compare run beside --quick --out away/compared",
    "certify": "certify run --json",
}
"""Command lines by name, in the folder that holds `run`."""


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each pair."""
    chosen = random.Random(0)
    with tempfile.TemporaryDirectory(prefix="expdesign-folders-") as place:
        trial = _Trials(Path(place))
        for number in range(1, _PAIRS + 1):
            first, second = chosen.choice(list(_COMMANDS)), chosen.choice(list(_COMMANDS))
            delay = round(chosen.uniform(0.0, _LONGEST_DELAY), 1)
            yield {"pair": number, **trial.judge(first, second, delay)}


def summary(table: pd.DataFrame) -> str:
    """Return the number of pairs without a finding."""
    good = int((table["findings"] == "").sum())
    refused = int((table["kept"] != "both").sum())
    return f"{good} of {len(table)} pairs without a finding; in {refused} one command was refused."


class _Trials:
    """Pairs of commands in copies of one folder, and the folders that they may leave."""

    def __init__(self, place: Path) -> None:
        self.place, self.template = place, place / "template"
        self.template.mkdir()
        self.allowed: dict[tuple[str, ...], dict[str, Any]] = {}
        for name, changes in _RUNS.items():
            with (self.template / f"{name}.yaml").open("w", encoding="utf-8") as stream:
                YAML(typ="safe").dump(tiny_run(robot=quick_robot(), **_COMMON, **changes), stream)
        for name in ("run", "beside"):
            # The first one also loads all modules and kernels into this process.
            with blank_figures(), chdir(self.template):
                if run(app, ["run", "first.yaml", "--out", name]):
                    raise RuntimeError("the folder of all pairs could not be made")

    def judge(self, first: str, second: str, delay: float) -> dict[str, Any]:
        """Run a pair and return its row."""
        folder = self._copy()
        processes = [_start(_COMMANDS[first], folder)]
        time.sleep(delay)
        processes.append(_start(_COMMANDS[second], folder))
        ends = [process.end() for process in processes]
        names = (first, second)
        done = tuple(
            name for name, (status, said) in zip(names, ends, strict=True) if not _refused(said)
        )
        orders = {done, done[::-1]}
        found = _state(folder, _answers(names, ends))
        findings = [*_amiss(ends), *_spoilt(folder / "run")]
        shutil.rmtree(folder)
        if found not in [self._state_after(order) for order in orders]:
            nearest = self._state_after(done)
            wrong = [k for k in found.keys() | nearest if found.get(k) != nearest.get(k)]
            findings.append(f"files of neither order: {', '.join(sorted(wrong)[:3])}")
        return {
            "first": first,
            "second": second,
            "delay": delay,
            "kept": {2: "both", 0: "none"}.get(len(done), " ".join(done)),
            "findings": "; ".join(findings),
        }

    def _state_after(self, order: tuple[str, ...]) -> dict[str, Any]:
        """Return the files after commands that ran one after the other."""
        if order not in self.allowed:
            folder = self._copy()
            ends = [_start(_COMMANDS[name], folder).end() for name in order]
            self.allowed[order] = _state(folder, _answers(order, ends))
            shutil.rmtree(folder)
        return self.allowed[order]

    def _copy(self) -> Path:
        # All copies have the same path, which some files contain.
        folder = self.place / "copy"
        shutil.copytree(self.template, folder)
        return folder


def quick_robot() -> dict[str, Any]:
    """Return PaLiDA with the limits that are quick to build."""
    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    for key in ("actuator_force", "jacobian_condition", "strut_clearance"):
        del robot["limits"][key]
    return dict(robot)


_COMMON: dict[str, Any] = {
    "estimate": {"estimators": ["ls"]},
    "export": [{"format": "xps-pvt", "segment": 0.02, "tolerance": 2e-4, "scale": 0.3}],
    "report": {"figures": ["svg"]},
}
_RUNS: dict[str, dict[str, Any]] = {
    "first": {"design": {"seed": 0, "smoothing": [0.4], "max_iterations": 4}},
    "other": {
        "design": {"seed": 1, "smoothing": [0.4], "max_iterations": 4},
        "experiment": {"seed": 1},
    },
    "further": {
        "design": {"seed": 1, "smoothing": [0.4], "max_iterations": 4},
        "experiment": {"seed": 1},
        "montecarlo": {"repetitions": 2, "estimators": ["ls"]},
        "validate": [{"motion": "circle", "periods": 3}],
    },
    "sweep": {
        "design": {"seed": 2, "smoothing": [0.4], "max_iterations": 4},
        "sweep": {"experiment.periods": [3, 4]},
    },
}


def _start(line: str, folder: Path) -> Any:
    """Start a command in a copy of this process, in which every module is loaded."""
    return CopiedRun(line.split(), folder)


def _refused(said: tuple[str, str]) -> bool:
    """Return whether a command was refused because of another one."""
    text = " ".join(" ".join(said).split())
    return any(words in text for words in ("has been writing to", "by another command while"))


def _answers(names: Sequence[str], ends: Sequence[tuple[int, tuple[str, str]]]) -> dict[str, Any]:
    """Return exit status and, of `certify`, the answer of each command that was not refused."""
    return {
        f"answer of {name}": (status, json.loads(said[0]) if name == "certify" else "")
        for name, (status, said) in zip(names, ends, strict=True)
        if not _refused(said)
    }


def _state(folder: Path, answers: dict[str, Any]) -> dict[str, Any]:
    return timeless_files(folder) | answers


def timeless_files(folder: Path) -> dict[str, Any]:
    """Return the content of the files, except for times: those of a sweep are in its table."""
    files = contents(folder)
    for name in [name for name in files if name.endswith("tables/sweep.csv")]:
        table = pd.read_csv(BytesIO(files[name])).drop(columns="cpu_seconds")
        files[name] = table.to_csv(index=False)
        run = name.removesuffix("tables/sweep.csv")
        for shown in ("tables/sweep.tex", "report.html", "figures/sweep.svg"):
            files.pop(f"{run}{shown}", None)
    return {name: files[name] for name in files if not name.endswith(Manifest.FILE)}


def _amiss(ends: Sequence[tuple[int, tuple[str, str]]]) -> Iterator[str]:
    for status, said in ends:
        if status not in (0, 1, 2):
            yield f"exit status {status}"
        if "Traceback" in " ".join(said):
            yield "a traceback"


def _spoilt(folder: Path) -> Iterator[str]:
    """Yield what the manifest contradicts, and whether the folder cannot be shown."""
    manifest = Manifest.read(folder)
    if not manifest.is_intact or manifest.run_file != known_hash(folder / RUN_FILE):
        yield "run.yaml or manifest.json is not as it was written"
    yield from (f"{file} is not as the manifest says" for file in manifest.changed_files(folder))
    yield from (f"{path.name} is left" for path in folder.parent.rglob(f"{LOCK[:10]}*"))
    opened = RunFolder.open(folder, reported_stages())
    for stage in opened.held:
        opened.view(stage)
