"""Random faults in the mathematics: the share that the tests of `make test` find.

cosmic-ray makes the faults (mutants), and coverage.py says which files of tests execute a
statement. Both have an environment of their own, ``build/mutants``: neither the product nor its
tests need them. Each fault is put into a copy of the working tree, where the files of tests of its
area that execute the faulty statement run, the shortest first, until a test fails; a fault they
miss may still be found by other tests. Each file is traced in a process of its own: a graph that a
session builds once counts for every file that uses it. Results are kept by commit.
"""

from __future__ import annotations

import ast
import json
import os
import random
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from time import monotonic
from typing import Any

import pandas as pd

from benchmarks.kept import keep

TITLE = "Random faults found by the tests"
SECTIONS = ("constraints", "dynamics", "criteria", "enclosures", "estimators", "noise", "export")

_ROOT = Path(__file__).resolve().parents[1]
_PLACE = _ROOT / "build" / "mutants"
_AREAS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "constraints": (("constraints",), ("constraints", "robot", "recheck")),
    "dynamics": (("expdesign/mechanism", "expdesign/robot"), ("robot", "multibody", "evaluation")),
    "criteria": (
        ("expdesign/information", "expdesign/problem"),
        ("information", "problem", "solver", "experiment"),
    ),
    "enclosures": (("expdesign/enclosure", "expdesign/recheck"), ("enclosure", "recheck")),
    "estimators": (
        ("estimation/estimators", "estimation/uncertainty", "estimation/measurement_model"),
        ("estimation",),
    ),
    "noise": (
        ("expdesign/noise.py", "estimation/processing"),
        ("noise", "data", "estimation", "diagnostics"),
    ),
    "export": (("expdesign/export",), ("export",)),
}
"""Folders with faults, and folders of tests, by area."""
_MUTANTS = 43
"""Faults of an area."""
_PATIENCE = 4
"""Tests end after so many times the time without a fault: it counts as found, as it would in CI."""
_SELECTION = "not slow and not system"


def rows(section: str | None = None, repetitions: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield a row for each fault: its place, the change, and the tests' verdict."""
    _prepare_environment()
    for area in SECTIONS if section is None else (section,):
        yield from _area_rows(area, repetitions or _MUTANTS)


def summary(table: pd.DataFrame) -> str:
    """Return the share of faults that are found, in all and by area."""
    found = table["verdict"] != "survived"
    parts = [
        f"{area} {100 * share:.0f} %" for area, share in found.groupby(table["area"]).mean().items()
    ]
    error = (found.mean() * (1 - found.mean()) / len(table)) ** 0.5
    return (
        f"{found.sum()} of {len(table)} faults are found ({100 * found.mean():.1f} ± "
        f"{100 * error:.1f} %): {', '.join(parts)}."
    )


@dataclass(frozen=True)
class TestFile:
    """A file of tests: how long it takes, and the lines of each module that it executes."""

    path: str
    seconds: float
    lines: dict[str, list[int]]


@dataclass(frozen=True)
class Verdict:
    """Whether the tests found a fault, by which test, and the change of its line."""

    verdict: str
    by: str
    change: str


def _area_rows(area: str, count: int) -> Iterator[dict[str, Any]]:
    folders, tests = _AREAS[area]
    trees: SimpleQueue[Path] = SimpleQueue()
    for number in range(os.cpu_count() or 1):
        trees.put(_copy_tree(number))

    def traced(path: str) -> TestFile:
        return TestFile(
            **keep("traced_tests", [path, folders], _in_tree, trees, _trace, path, folders)
        )

    def judged(mutation: dict[str, Any]) -> Verdict:
        arguments = (trees, _judge, mutation, _tests_of(mutation, files))
        return Verdict(**keep("mutants", mutation["id"], _in_tree, *arguments))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        files = sorted(pool.map(traced, _test_files(tests)), key=lambda file: file.seconds)
        chosen = _draw(_all_mutations(folders), count, seed=area)
        for mutation, verdict in zip(chosen, pool.map(judged, chosen), strict=True):
            yield {
                "area": area,
                "place": f"{mutation['module']}:{mutation['line']}",
                "change": verdict.change.replace("|", "\\|"),
                "verdict": verdict.verdict,
                "by": verdict.by,
            }


def _in_tree(trees: SimpleQueue[Path], compute: Callable[..., Any], *arguments: Any) -> Any:
    """Compute with a tree that no other thread uses."""
    tree = trees.get()
    try:
        return compute(tree, *arguments)
    finally:
        trees.put(tree)


# --- faults ---------------------------------------------------------------------------------------

_WORKER = """
import json, sys
from pathlib import Path
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from coverage import CoverageData
if sys.argv[1] == "list":
    with use_db(":memory:", WorkDB.Mode.create) as database:
        init([Path(one) for one in sys.argv[2:]], database, {})
        print(json.dumps([
            [str(m.module_path), m.operator_name, m.occurrence, *m.start_pos, *m.end_pos]
            for item in database.work_items for m in item.mutations
        ]))
elif sys.argv[1] == "lines":
    data = CoverageData(sys.argv[2])
    data.read()
    files = {str(Path(f).relative_to(sys.argv[3])): data.lines(f) for f in data.measured_files()}
    print(json.dumps(files))
else:
    path, operator, occurrence = sys.argv[2:]
    print(mutate_code(Path(path).read_text(), get_operator(operator)(), int(occurrence)), end="")
"""


def _prepare_environment() -> None:
    python = _PLACE / "bin" / "python"
    if not python.exists():
        venv.create(_PLACE, with_pip=True)
        requirements = _ROOT / "requirements" / "mutants.txt"
        options = ["--quiet", "--require-hashes", "-r", str(requirements)]
        subprocess.run([str(python), "-m", "pip", "install", *options], check=True)
        # The tests' environment sees coverage.py alone of what is installed here.
        (_PLACE / "coverage").mkdir()
        (_PLACE / "coverage" / "coverage").symlink_to(next(_PLACE.glob("lib/*/*/coverage")))


def _ask_cosmic_ray(*arguments: str) -> str:
    command = [str(_PLACE / "bin" / "python"), "-c", _WORKER, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=_ROOT).stdout


def _all_mutations(folders: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the mutations of all modules, without those that change nothing that runs."""
    places = [_ROOT / folder for folder in folders]
    files = [f for place in places for f in ([place] if place.is_file() else place.rglob("*.py"))]
    modules = sorted(str(file.relative_to(_ROOT)) for file in files)
    idle = {module: _idle_lines((_ROOT / module).read_text()) for module in modules}
    found = []
    for module, operator, occurrence, *place in json.loads(_ask_cosmic_ray("list", *modules)):
        if not any(first <= (place[0], place[1]) < last for first, last in idle[module]):
            name = operator.removeprefix("core/")
            found.append(
                {"id": f"{module}:{name}:{occurrence}", "module": module, "operator": operator}
                | {"occurrence": occurrence, "line": place[0], "column": place[1]}
            )
    return found


def _idle_lines(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the places of annotations and decorators: their mutants run like the original."""
    nodes: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.AnnAssign | ast.arg):
            nodes.append(node.annotation)
        elif isinstance(node, ast.FunctionDef):
            nodes += [node.returns, *node.decorator_list]
        elif isinstance(node, ast.ClassDef):
            nodes += node.decorator_list
    return [((node.lineno, node.col_offset - 1), _end(node)) for node in nodes if node is not None]


def _end(node: ast.expr | ast.stmt) -> tuple[int, int]:
    return node.end_lineno or node.lineno, node.end_col_offset or node.col_offset + 1


def _draw(mutations: list[dict[str, Any]], count: int, seed: str) -> list[dict[str, Any]]:
    """Draw places at random, and one of the changes of each."""
    draw = random.Random(seed)
    places: dict[tuple[str, int, int], list[dict[str, Any]]] = {}
    for mutation in mutations:
        places.setdefault(tuple(mutation[k] for k in ("module", "line", "column")), []).append(
            mutation
        )
    chosen = draw.sample(sorted(places), min(count, len(places)))
    return [draw.choice(places[place]) for place in chosen]


# --- tests ----------------------------------------------------------------------------------------


def _copy_tree(number: int) -> Path:
    """Return a fresh copy of the files that git knows."""
    tree = _PLACE / f"tree-{number}"
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z"], check=True, capture_output=True, text=True, cwd=_ROOT
    ).stdout
    for name in filter(None, listed.split("\0")):
        target = tree / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(_ROOT / name, target)
    return tree


_NO_TESTS = 5
"""pytest's exit status when all tests of a file are left out."""


def _test_files(tests: tuple[str, ...]) -> list[str]:
    found = [path for name in tests for path in sorted((_ROOT / "tests" / name).glob("test_*.py"))]
    return [str(path.relative_to(_ROOT)) for path in found]


def _tests_of(mutation: dict[str, Any], files: list[TestFile]) -> list[TestFile]:
    """Return the files that execute the statement, or those that import the module if none does.

    Compiled code and other processes are not traced.
    """
    module = mutation["module"]
    statements = [
        node
        for node in ast.walk(ast.parse((_ROOT / module).read_text()))
        if isinstance(node, ast.stmt) and node.lineno <= mutation["line"] <= _end(node)[0]
    ]
    innermost = min(statements, key=lambda node: _end(node)[0] - node.lineno)
    lines = set(range(innermost.lineno, _end(innermost)[0] + 1))
    executing = [file for file in files if lines & set(file.lines.get(module, ()))]
    return executing or [file for file in files if module in file.lines] or files


def _trace(tree: Path, path: str, folders: tuple[str, ...]) -> TestFile:
    """Run a file of tests without a fault, and note the lines of the folders that it executes."""
    (data := tree / "traced").unlink(missing_ok=True)
    include = ",".join(f"{tree / one}" + ("" if one.endswith(".py") else "/*") for one in folders)
    start = monotonic()
    done = _run_pytest(
        tree, [path], None, "coverage", "run", f"--data-file={data}", f"--include={include}", "-m"
    )
    if done.returncode not in {0, _NO_TESTS}:
        raise RuntimeError(f"The tests fail without a fault: {done.stdout}{done.stderr}")
    lines = {} if done.returncode else json.loads(_ask_cosmic_ray("lines", str(data), str(tree)))
    return TestFile(path, monotonic() - start, lines)


def _judge(tree: Path, mutation: dict[str, Any], files: list[TestFile]) -> Verdict:
    """Run the tests of a fault."""
    module = tree / mutation["module"]
    original = module.read_text()
    arguments = (str(module), mutation["operator"], str(mutation["occurrence"]))
    changed = _ask_cosmic_ray("mutate", *arguments)
    pairs = zip(original.splitlines(), changed.splitlines(), strict=False)
    old, new = next(((a, b) for a, b in pairs if a != b), ("", ""))
    change = f"`{old.strip()}` → `{new.strip()}`"
    seconds = 60 + _PATIENCE * sum(file.seconds for file in files)
    module.write_text(changed)
    try:
        done = _run_pytest(tree, [file.path for file in files], seconds)
    except subprocess.TimeoutExpired:
        return Verdict("too slow", "", change)
    finally:
        module.write_text(original)
    if done.returncode == 0:
        return Verdict("survived", "", change)
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return Verdict("found", "".join(lines[:1]).split(" - ")[0].removeprefix("FAILED "), change)


def _run_pytest(
    tree: Path, paths: list[str], seconds: float | None, *before: str
) -> subprocess.CompletedProcess[str]:
    """Run files of tests in a copy, until one fails."""
    options = ["-m", _SELECTION, "-q", "-x", "--no-header", "-p", "no:cacheprovider", "-n", "0"]
    # Without stored bytecode: a fault may have the size and the second of the original.
    environment = os.environ | {"PYTHONPATH": f"{tree}:{_PLACE / 'coverage'}"}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(tree / "numba")}
    return subprocess.run(
        [sys.executable, "-m", *before, "pytest", *options, *paths],
        check=False,
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        timeout=seconds,
    )
