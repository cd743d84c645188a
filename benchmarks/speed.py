"""Speed beside the version before machine code and the dense solver, in turns in one run.

The earlier one stands in a work tree of its own with an environment of its own, in
`build/before`. Every figure is of a whole process, with what its children took.

The section `pinocchio` is beside another program (`benchmarks/beside_pinocchio.py` says how).
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml  # type: ignore[import-untyped]

from benchmarks.beside_pinocchio import STATES, beside_pinocchio
from benchmarks.effort import BEST_KNOWN
from expdesign.export.formats import table_formats

TITLE = "Speed"
BEFORE = "b64af2b5a"
"""The commit before."""

Row = dict[str, Any]
_HERE = Path(__file__).resolve().parents[1]
_PARAMETERS = 24
_RUN: dict[str, Any] = {
    "robot": "palida",
    "trajectory": {"harmonics": 5, "samples": 200, "controller_period": "1 ms"},
}


@dataclass(frozen=True)
class Version:
    """A checkout with its environment."""

    name: str
    folder: Path

    def run(self, *arguments: str | Path) -> Spent:
        """Run `expdesign` with arguments; tell what it took."""
        python = self.folder / ".venv" / "bin" / "python"
        command = [python, "-m", "expdesign", *arguments]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(self.folder)}
        with tempfile.TemporaryFile() as output:
            began = time.perf_counter()
            process = subprocess.Popen(
                [str(part) for part in command],
                env=environment,
                cwd=self.folder,  # Python looks there first for what it runs
                stdout=output,
                stderr=output,
            )
            _, status, used = os.wait4(process.pid, 0)
            seconds = time.perf_counter() - began
            output.seek(0)
            written = output.read().decode()
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in {0, 1}:
            raise RuntimeError(f"{self.name}: {command}: {written}")
        return Spent(seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20)


@dataclass(frozen=True)
class Spent:
    """What a process took."""

    seconds: float
    cpu: float
    """Seconds, with those of its children."""
    memory: float
    """Largest resident memory, GiB."""


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` instead of its own."""
    measure, wanted = SECTIONS[section]
    return measure(repetitions or wanted)


def summary(table: pd.DataFrame) -> str:
    """Return the medians of what is compared."""
    if "times faster" not in table:
        return str(table.attrs.get("summary", f"{len(table)} rows"))
    faster = table["times faster"].dropna()
    return f"median {faster.median():.1f} times faster, {faster.min():.1f} at least"


def _versions() -> tuple[Version, Version]:
    """Return the version before and this one; make the former where it is not there yet."""
    folder = _HERE / "build" / "before" / BEFORE
    if not (folder / ".venv" / ".installed").exists():
        shutil.rmtree(folder, ignore_errors=True)
        tree = ["git", "-C", str(_HERE), "worktree"]
        subprocess.run([*tree, "prune"], check=True)
        subprocess.run([*tree, "add", "--detach", str(folder), BEFORE], check=True)
        subprocess.run(["make", "-C", str(folder), "venv"], check=True)
    return Version("before", folder), Version("now", _HERE)


def _compared(what: str, before: list[float], now: list[float], unit: str = "s") -> Row:
    """Return a row: medians with their ranges, and how many times faster."""
    return {
        "what": what,
        "before": _spread(before, unit),
        "now": _spread(now, unit),
        "times faster": round(float(np.median(before) / np.median(now)), 1),
    }


def _spread(values: list[float], unit: str) -> str:
    low, middle, high = np.quantile(values, [0, 0.5, 1])
    return f"{middle:.3g} ({low:.3g} … {high:.3g}) {unit}"


def _design(version: Version, run: dict[str, Any], folder: Path) -> tuple[Spent, dict[str, Any]]:
    """Return what a design took, and its `design.json`."""
    file = folder / "run.yaml"
    file.write_text(yaml.safe_dump({"name": "speed", **run}))
    out = folder / "out"
    spent = version.run("run", file, "--out", out)
    found = json.loads((out / "design.json").read_text())
    shutil.rmtree(out)
    return spent, found


def _starts(repetitions: int) -> Iterator[Row]:
    """Compare one start, finished and proved: time, evaluations, and what it reached."""
    before, now = _versions()
    spent: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as place:
        for seed in range(repetitions):
            for version in (before, now):
                run = {**_RUN, "design": {"starts": 1, "search": "restarts", "seed": seed}}
                whole, found = _design(version, run, Path(place))
                for key, value in (
                    ("process", whole.cpu),
                    ("search", found["solver"]["seconds"]),
                    ("reached", found["log_det_information"]),
                    ("iterations", found["solver"]["iterations"]),
                    ("gradients", found["solver"]["evaluations"]["grad_f"]),
                ):
                    spent.setdefault(f"{version.name} {key}", []).append(value)
    for key, what in (
        ("search", "one start of palida, finished and proved"),
        ("process", "the same, whole process, CPU time"),
    ):
        yield _compared(what, spent[f"before {key}"], spent[f"now {key}"])
    for key, what in (
        ("reached", "log det F reached"),
        ("iterations", "iterations"),
        ("gradients", "evaluations of the gradient"),
    ):
        each = [_spread(spent[f"{name} {key}"], "") for name in ("before", "now")]
        yield {"what": what, "before": each[0], "now": each[1], "times faster": np.nan}


def _main(repetitions: int) -> Iterator[Row]:
    """Run what each version ships: seeds in turns."""
    before, now = _versions()
    with tempfile.TemporaryDirectory() as place:
        for seed in range(repetitions):
            for version in (before, now):
                shipped = version.folder / "expdesign" / "library" / "runs" / "palida.yaml"
                run = yaml.safe_load(shipped.read_text())
                run["design"]["seed"] = seed
                spent, found = _design(version, run, Path(place))
                reached = found["log_det_information"]
                yield {
                    "seed": seed,
                    "version": version.name,
                    "log det F": round(reached, 3),
                    "D-efficiency %": round(
                        100 * float(np.exp((reached - BEST_KNOWN) / _PARAMETERS)), 1
                    ),
                    "status": found["status"],
                    "seconds": round(spent.seconds, 1),
                    "CPU seconds": round(spent.cpu, 1),
                }


def _commands(repetitions: int) -> Iterator[Row]:
    """Compare the other commands of a user's day, on one design that both versions read."""
    before, now = _versions()
    with tempfile.TemporaryDirectory() as place:
        folders = {}
        for version in (before, now):
            folders[version.name] = Path(place) / version.name
            file = Path(place) / "run.yaml"
            file.write_text(
                yaml.safe_dump(
                    {"name": "speed", **_RUN, "design": {"starts": 1, "search": "restarts"}}
                )
            )
            before.run("run", file, "--out", folders[version.name])
        commands: dict[str, Callable[[Path], tuple[str | Path, ...]]] = {
            "expdesign --help": lambda _folder: ("--help",),
            "expdesign check palida": lambda _folder: ("check", "palida"),
            "expdesign report": lambda folder: ("report", folder),
            **{
                f"expdesign export --format {name}": partial(_export, name)
                for name in table_formats()
            },
        }
        for what, command in commands.items():
            spent: dict[str, list[float]] = {"before": [], "now": []}
            for _ in range(repetitions):
                for version in (before, now):
                    folder = folders[version.name]
                    spent[version.name].append(version.run(*command(folder)).cpu)
            yield _compared(what, spent["before"], spent["now"])


def _export(name: str, folder: Path) -> tuple[str | Path, ...]:
    shutil.rmtree(folder / "exports", ignore_errors=True)
    return "export", folder, "--format", name


def _kernels(repetitions: int) -> Iterator[Row]:
    """Compare machine code with CasADi's virtual machine: µs a sample."""
    found: dict[str, dict[str, list[float]]] = {}
    for evaluator in ("virtual-machine", "machine-code"):
        script = Path(__file__).with_name("kernels.py")
        environment = {**os.environ, "EXPDESIGN_EVALUATOR": evaluator, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            [_HERE / ".venv" / "bin" / "python", script, str(repetitions)],
            env=environment | {"PYTHONPATH": str(_HERE)},
            capture_output=True,
            text=True,
            check=True,
        )
        found[evaluator] = json.loads(done.stdout)
    for what, taken in found["machine-code"].items():
        yield _compared(f"{what}, µs a sample", found["virtual-machine"][what], taken, "µs")


def _growth(repetitions: int) -> Iterator[Row]:
    """Measure how the time of one finished start grows with n and N, and the memory with N."""
    now = _versions()[1]
    with tempfile.TemporaryDirectory() as place:
        for what, values in (
            ("harmonics", (3, 5, 8, 12, 20, 30)),
            ("samples", (200, 600, 2000, 6000, 20_000)),
        ):
            medians = []
            for value in values:
                trajectory = {**_RUN["trajectory"], what: value}
                design = {"starts": 1, "search": "restarts"}
                taken, reached, memory = [], [], []
                for seed in range(repetitions):
                    run = {**_RUN, "trajectory": trajectory, "design": {**design, "seed": seed}}
                    spent, found = _design(now, run, Path(place))
                    taken.append(spent.cpu)
                    reached.append(found["log_det_information"])
                    memory.append(spent.memory)
                medians.append(float(np.median(taken)))
                yield {
                    "what": f"{what} {value}",
                    "CPU seconds": _spread(taken, "s"),
                    "log det F": _spread(reached, ""),
                    "largest memory": f"{max(memory):.2f} GiB",
                }
            slope = np.polyfit(np.log(values), np.log(medians), 1)[0]
            last = np.log(medians[-1] / medians[-2]) / np.log(values[-1] / values[-2])
            yield {
                "what": f"time grows as {what}^",
                "CPU seconds": f"{slope:.2f} fitted, {last:.2f} at the end",
            }


def _pinocchio(repetitions: int) -> Iterator[Row]:
    """Compare the regressor with Pinocchio's."""
    found = beside_pinocchio(repetitions)
    if found is None:
        return
    yield {
        "what": f"forces in {STATES} states, of {found.largest:.0f} N: apart at most by",
        "Pinocchio": found.version,
        "expdesign": f"{found.apart:.0e} of the largest",
        "times faster": np.nan,
    }
    tree = "computeJointTorqueRegressor, (24, 190)"
    for what, name, ours in (
        (f"{tree}, and A of the bodies, (6, 10): µs a sample", "tree", "rigid"),
        (f"{tree}, and A with friction, (6, 24)", "tree", "friction"),
        ("the former with closed loops by NumPy, (6, 190), and A (6, 10)", "actuators", "rigid"),
    ):
        row = _compared(what, found.taken[name], found.taken[ours], "µs")
        yield {
            "what": what,
            "Pinocchio": row["before"],
            "expdesign": row["now"],
            "times faster": row["times faster"],
        }


SECTIONS: dict[str, tuple[Callable[[int], Iterator[Row]], int]] = {
    "start": (_starts, 20),
    "main": (_main, 5),
    "commands": (_commands, 3),
    "kernels": (_kernels, 5),
    "growth": (_growth, 1),
    "pinocchio": (_pinocchio, 5),
}
"""How each section is measured, and how often."""
