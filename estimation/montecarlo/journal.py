"""The journal of a study: one line per repetition that is done, so that none is done twice.

Its first line tells what the repetitions were made from. A line is written when its repetition
ends, whatever the order; a last line that a crash left incomplete is dropped and done again.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from estimation.montecarlo.repetition import Repetition
from expdesign.runfolder.atomic import naming, plain, write_text
from expdesign.runfolder.described import checker
from expdesign.runfolder.json_file import FORMAT, known_format

_FORMAT = 1
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
        self._header = json.dumps({FORMAT: _FORMAT, "inputs": inputs}) + "\n"
        self._inputs = inputs
        self._valid = self._read()

    def _read(self) -> int:
        """Take what the file holds; return how many of its bytes are whole lines of this study."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return 0
        if not lines or not self._is_of_this_study(lines[0]):
            return 0
        size = len(lines[0])
        for line in lines[1:]:
            try:
                repetition = checker(Repetition).validate_json(line)
            except ValueError:
                break
            if not line.endswith(b"\n"):
                break
            self.done[repetition.number] = repetition
            size += len(line)
        return size

    def _is_of_this_study(self, line: bytes) -> bool:
        try:
            header = json.loads(line)
        except ValueError:
            return False
        if not isinstance(header, dict) or header.get("inputs") != self._inputs:
            return False
        known_format(self.path, header.get(FORMAT, 0), _FORMAT)
        return True

    def add(self, repetition: Repetition) -> None:
        """Keep a repetition; it is on disk when this returns."""
        if not self._valid:
            write_text(self.path, self._header)
            self._valid = len(self._header)
        line = (json.dumps(plain(checker(Repetition).dump_python(repetition))) + "\n").encode()
        with naming(self.path), self.path.open("r+b") as stream:
            stream.truncate(self._valid)
            stream.seek(self._valid)
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._valid += len(line)
        self.done[repetition.number] = repetition
