"""Results of long benchmarks, kept by commit, so that a measurement continues where it ended."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[1]
_CHANGED = "-changed"
"""Mark of a working tree with changes: its results are not kept."""


def keep(benchmark: str, key: Any, compute: Callable[..., Any], *arguments: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that is kept under a key, or compute and keep them."""
    kept, text = _kept(benchmark), json.dumps(key)
    if text not in kept:
        kept[text] = asdict(compute(*arguments))
        if not _commit().endswith(_CHANGED):
            with _results(benchmark).open("a") as file:
                file.write(json.dumps([text, kept[text]]) + "\n")
    return kept[text]


def _results(benchmark: str) -> Path:
    return _ROOT / "build" / benchmark / f"{_commit()}.jsonl"


@cache
def _kept(benchmark: str) -> dict[str, dict[str, Any]]:
    path = _results(benchmark)
    path.parent.mkdir(parents=True, exist_ok=True)
    return dict(map(json.loads, path.read_text().splitlines())) if path.exists() else {}


@cache
def _commit() -> str:
    command = ["git", "-C", str(_ROOT), "describe", "--always", f"--dirty={_CHANGED}"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
