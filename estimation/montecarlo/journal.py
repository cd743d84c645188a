"""The journal of a study: one line per repetition that is done, so that none is done twice.

Its first line tells what the repetitions were made from. A line is written when its repetition
ends, whatever the order; a last line that a crash left incomplete is dropped and done again.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from estimation.montecarlo.repetition import Outcome, Repetition
from expdesign.runfolder.atomic import write_text

NAME = "montecarlo/repetitions.jsonl"


class Journal:
    """Repetitions on disk.

    Parameters
    ----------
    path : Path
    inputs : str
        Hash of what repetitions are made from. A journal of other inputs counts as empty, and is
        replaced when the first repetition is added.

    Attributes
    ----------
    done : dict of Repetition
        By number.
    """

    def __init__(self, path: Path, inputs: str) -> None:
        self.path = path
        self.done: dict[int, Repetition] = {}
        self._header = json.dumps({"inputs": inputs}) + "\n"
        self._valid = self._read()

    def _read(self) -> int:
        """Take what the file holds; return how many of its bytes are whole lines of this study."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return 0
        if not lines or lines[0] != self._header.encode():
            return 0
        size = len(lines[0])
        for line in lines[1:]:
            try:
                repetition = _parsed(json.loads(line))
            except (ValueError, KeyError, TypeError):
                break
            if not line.endswith(b"\n"):
                break
            self.done[repetition.number] = repetition
            size += len(line)
        return size

    def add(self, repetition: Repetition) -> None:
        """Keep a repetition; it is on disk when this returns."""
        if not self._valid:
            write_text(self.path, self._header)
            self._valid = len(self._header)
        line = (json.dumps(_plain(repetition)) + "\n").encode()
        with self.path.open("r+b") as stream:
            stream.truncate(self._valid)
            stream.seek(self._valid)
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._valid += len(line)
        self.done[repetition.number] = repetition


def _plain(repetition: Repetition) -> dict[str, Any]:
    freedom = repetition.freedom
    return {
        "number": repetition.number,
        "harmonics": repetition.harmonics,
        "freedom": freedom if math.isfinite(freedom) else None,
        "outcomes": {
            name: {
                "values": None if outcome.values is None else outcome.values.tolist(),
                "std": None if outcome.std is None else outcome.std.tolist(),
                "converged": outcome.converged,
                "iterations": outcome.iterations,
                "error": outcome.error,
            }
            for name, outcome in repetition.outcomes.items()
        },
    }


def _parsed(data: dict[str, Any]) -> Repetition:
    return Repetition(
        number=int(data["number"]),
        harmonics=data["harmonics"],
        freedom=np.inf if data["freedom"] is None else float(data["freedom"]),
        outcomes={
            name: Outcome(
                None if outcome["values"] is None else np.array(outcome["values"], dtype=float),
                None if outcome["std"] is None else np.array(outcome["std"], dtype=float),
                bool(outcome["converged"]),
                int(outcome["iterations"]),
                str(outcome["error"]),
            )
            for name, outcome in data["outcomes"].items()
        },
    )
