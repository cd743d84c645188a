"""`make bench`: measure the claims that are too long for the tests, and write their tables.

Every benchmark is a module with ``TITLE``, ``rows()`` and ``summary(table)``. Its table goes to
``benchmarks/tables/<name>.md`` row by row, with the command and the date. A benchmark with
``SECTIONS`` has a table for each, ``rows(section, repetitions)``, and its sections can be named
after it: ``python benchmarks/run.py montecarlo nominal --repetitions 20``.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

NAMES = (
    "effort",
    "schedule",
    "condition",
    "harmonics",
    "montecarlo",
    "roundtrip",
    "departures",
    "channels",
    "term_selection",
    "multibody",
    "tolerances",
    "totals",
    "constants",
    "calls",
    "control_model",
    "screws",
    "imported",
    "own_machine",
    "payload",
    "certificate",
    "certified_robots",
    "feedforward",
    "base_parameters",
    "speed",
    "physical_consistency",
    "mutants",
    "unknowns",
    "shots",
    "long_tables",
    "folders",
    "kills",
    "changed_files",
)


def main() -> None:
    """Run the benchmarks named on the command line, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(NAMES)}; sections of a benchmark may follow its name",
    )
    parser.add_argument(
        "--repetitions", type=int, metavar="K", help="of the sections that repeat something"
    )
    arguments = parser.parse_args()
    for name, section in _wanted(arguments.names or list(NAMES), parser):
        measure(name, section, arguments.repetitions)


def _wanted(words: list[str], parser: argparse.ArgumentParser) -> list[tuple[str, str | None]]:
    """Return benchmarks with their sections, None for those that have none."""
    chosen: list[tuple[str, list[str]]] = []
    for word in words:
        # Of a word that is both, the section of the benchmark before it is meant.
        if chosen and word in _sections(chosen[-1][0]):
            chosen[-1][1].append(word)
        elif word in NAMES:
            chosen.append((word, []))
        else:
            known = f"; its sections are {', '.join(_sections(chosen[-1][0]))}" if chosen else ""
            parser.error(f"unknown benchmark '{word}'; there are {', '.join(NAMES)}{known}")
    wanted: list[tuple[str, str | None]] = []
    for name, sections in chosen:
        named = sections or _sections(name)
        wanted += [(name, section) for section in named] or [(name, None)]
    return wanted


def _module(name: str) -> Any:
    return importlib.import_module(f"benchmarks.{name}")


def _sections(name: str) -> list[str]:
    return list(getattr(_module(name), "SECTIONS", ()))


def measure(name: str, section: str | None = None, repetitions: int | None = None) -> None:
    """Run one benchmark, or a section of it; its table is complete as far as it got."""
    module = _module(name)
    called = name if section is None else f"{name} {section}"
    title = module.TITLE if section is None else f"{module.TITLE}: {section}"
    command = called if repetitions is None else f"{called} --repetitions {repetitions}"
    rows: Iterator[dict[str, object]]
    rows = module.rows() if section is None else module.rows(section, repetitions)
    done: list[dict[str, object]] = []
    for row in rows:
        done.append(row)
        print(f"{called}: {row}", flush=True)
        write(called, title, command, pd.DataFrame(done), "")
    if not done:  # It has said why; what was measured before stays.
        return
    table = pd.DataFrame(done)
    text = module.summary(table)
    print(f"{called}: {text}", flush=True)
    write(called, title, command, table, text)


def write(name: str, title: str, command: str, table: pd.DataFrame, text: str) -> None:
    """Write a table as Markdown."""
    head = "| " + " | ".join(table.columns) + " |"
    rule = "|" + "---|" * len(table.columns)
    body = ["| " + " | ".join(str(v) for v in row) + " |" for row in table.itertuples(index=False)]
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    machine = f"Python {platform.python_version()}, {os.cpu_count()} cores"
    arguments = command if " " not in command else f'"{command}"'
    origin = f"`make bench ARGS={arguments}`, {today}, {machine}"
    path = Path(__file__).parent / "tables" / f"{name.replace(' ', '_').replace('-', '_')}.md"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([f"# {title}", "", origin, "", head, rule, *body, "", text, ""]))


if __name__ == "__main__":
    main()
