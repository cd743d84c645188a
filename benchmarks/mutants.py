"""Random faults in the mathematics: the share that the tests of `make test` find.

cosmic-ray makes the faults (mutants). It has an environment of its own, ``build/mutants``, since
neither the product nor its tests need it. Each fault is put into a copy of the working tree, where
the tests of its area run until the first one fails; a fault that they miss may still be found by
other tests. Results are kept in ``build/mutants/results``, so that a run continues where it ended.
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
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pandas as pd

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
_SECONDS = 900
"""Time after which the tests of a fault end; it counts as found, as it would in CI."""
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


def _area_rows(area: str, count: int) -> Iterator[dict[str, Any]]:
    folders, tests = _AREAS[area]
    results = _PLACE / "results" / f"{area}.jsonl"
    results.parent.mkdir(parents=True, exist_ok=True)
    known = {}
    if results.exists():
        known = {row["id"]: row for row in map(json.loads, results.read_text().splitlines())}
    chosen = _draw(_all_mutations(folders), count, seed=area)
    trees: SimpleQueue[Path] = SimpleQueue()
    for number in range(os.cpu_count() or 1):
        trees.put(_copy_tree(number))

    def judge(mutation: dict[str, Any]) -> dict[str, Any]:
        if (row := known.get(mutation["id"])) is not None:
            return row
        tree = trees.get()
        try:
            row = mutation | {"area": area} | _run_tests(tree, mutation, tests)
        finally:
            trees.put(tree)
        with results.open("a") as file:
            file.write(json.dumps(row) + "\n")
        return row

    if (unchanged := _run_tests(trees.get(), None, tests))["verdict"] != "survived":
        raise RuntimeError(f"{area}: the tests fail without a fault: {unchanged['by']}")
    trees.put(_copy_tree(0))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for row in pool.map(judge, chosen):
            yield {
                "area": area,
                "place": f"{row['module']}:{row['line']}",
                "change": row["change"].replace("|", "\\|"),
                "verdict": row["verdict"],
                "by": row["by"],
            }


# --- faults ---------------------------------------------------------------------------------------

_LISTER = """
import json, sys
from pathlib import Path
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
if sys.argv[1] == "list":
    with use_db(":memory:", WorkDB.Mode.create) as database:
        init([Path(one) for one in sys.argv[2:]], database, {})
        print(json.dumps([
            [str(m.module_path), m.operator_name, m.occurrence, *m.start_pos, *m.end_pos]
            for item in database.work_items for m in item.mutations
        ]))
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


def _ask_cosmic_ray(*arguments: str) -> str:
    command = [str(_PLACE / "bin" / "python"), "-c", _LISTER, *arguments]
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


def _end(node: ast.expr) -> tuple[int, int]:
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


def _run_tests(
    tree: Path, mutation: dict[str, Any] | None, tests: tuple[str, ...]
) -> dict[str, str]:
    """Run the tests of an area in a copy, with a mutation or without."""
    original = changed = ""
    if mutation is not None:
        module = tree / mutation["module"]
        original = module.read_text()
        arguments = (str(module), mutation["operator"], str(mutation["occurrence"]))
        changed = _ask_cosmic_ray("mutate", *arguments)
        module.write_text(changed)
    folders = [f"tests/{name}" for name in tests if (tree / "tests" / name).exists()]
    selection = ["-m", _SELECTION, "-q", "-x", "--no-header", "-p", "no:cacheprovider", "-n", "0"]
    # Without stored bytecode: a fault may have the size and the second of the original.
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"NUMBA_CACHE_DIR": str(tree / "numba")}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *selection, *folders],
            check=False,
            cwd=tree,
            env=environment,
            capture_output=True,
            text=True,
            timeout=_SECONDS,
        )
        lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        verdict, by = ("survived", "") if done.returncode == 0 else ("found", "".join(lines[:1]))
    except subprocess.TimeoutExpired:
        verdict, by = "too slow", ""
    finally:
        if mutation is not None:
            module.write_text(original)
    change = ""
    if mutation is not None:
        pairs = zip(original.splitlines(), changed.splitlines(), strict=False)
        old, new = next(((a, b) for a, b in pairs if a != b), ("", ""))
        change = f"`{old.strip()}` → `{new.strip()}`"
    return {"verdict": verdict, "by": by.split(" - ")[0].removeprefix("FAILED "), "change": change}
