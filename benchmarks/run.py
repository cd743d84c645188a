"""`make bench`: measure the claims that are too long for the tests, and write their tables.

Every benchmark is a module with ``TITLE``, ``rows()`` and ``summary(table)``. Its table goes to
``benchmarks/tables/<name>.md`` row by row, with the command and the date.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import os
import platform
import sys
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

NAMES = ("design_seeds", "condition", "hopping", "harmonics")


def main() -> None:
    """Run the benchmarks named on the command line, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}")
    wanted = parser.parse_args().names or list(NAMES)
    for name in wanted:
        if name not in NAMES:
            parser.error(f"unknown benchmark '{name}'; there are {', '.join(NAMES)}")
    for name in wanted:
        measure(name)


def measure(name: str) -> None:
    """Run one benchmark; its table is complete as far as it got."""
    module = importlib.import_module(f"benchmarks.{name}")
    done: list[dict[str, object]] = []
    for row in module.rows():
        done.append(row)
        print(f"{name}: {row}", flush=True)
        write(name, module.TITLE, pd.DataFrame(done), "")
    table = pd.DataFrame(done)
    text = module.summary(table)
    print(f"{name}: {text}", flush=True)
    write(name, module.TITLE, table, text)


def write(name: str, title: str, table: pd.DataFrame, text: str) -> None:
    """Write a table as Markdown."""
    head = "| " + " | ".join(table.columns) + " |"
    rule = "|" + "---|" * len(table.columns)
    body = ["| " + " | ".join(str(v) for v in row) + " |" for row in table.itertuples(index=False)]
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    machine = f"Python {platform.python_version()}, {os.cpu_count()} cores"
    origin = f"`make bench ARGS={name}`, {today}, {machine}"
    path = Path(__file__).parent / "tables" / f"{name}.md"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([f"# {title}", "", origin, "", head, rule, *body, "", text, ""]))


if __name__ == "__main__":
    main()
