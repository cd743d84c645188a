"""The lines of a text file, block by block: what is in memory does not grow with the file."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

from expdesign.configuration import InputError

BLOCK = 4 * 1024 * 1024
"""Characters of a block, but for its last line."""

LONGEST_LINE = 1024 * 1024
"""Characters."""

_ENCODINGS = ("utf-8-sig", "cp1252")
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def encoding_of(path: Path) -> str:
    """Return the encoding of a text: UTF-8, UTF-16 by its mark, or Windows-1252.

    Raises
    ------
    InputError
        It is no text.
    """
    with path.open("rb") as stream:
        marked = stream.read(len(_MARKS[0])) in _MARKS
    for encoding in ("utf-16",) if marked else _ENCODINGS:
        try:
            with path.open(encoding=encoding) as stream:
                while text := stream.read(BLOCK):
                    if "\0" in text:
                        raise _no_text(path)
        except UnicodeError:
            continue
        return encoding
    raise _no_text(path)


def _no_text(path: Path) -> InputError:
    return InputError("the file is no text", path, allowed="text in UTF-8")


def line_blocks(path: Path) -> Iterator[list[str]]:
    """Yield the lines of a text without their ends, some tens of thousands at once.

    Lines that are blank to the end of the file are none.

    Raises
    ------
    InputError
        It is no text, or a line is longer than any of a table.
    """
    with path.open(encoding=encoding_of(path)) as stream:
        # Blank lines are told when text follows: only their number is kept until then.
        number, blank = 0, 0
        before: list[str] = []
        while text := stream.read(BLOCK):
            if not text.endswith("\n"):
                text += stream.readline(LONGEST_LINE + 1)
            lines = text.split("\n")
            if not lines[-1]:
                lines.pop()
            for n, line in enumerate(lines, number + 1):
                if len(line) > LONGEST_LINE:
                    allowed = f"{LONGEST_LINE} characters"
                    raise InputError("the line is too long", path, n, allowed=allowed)
            number += len(lines)
            filled = next((n for n in range(len(lines), 0, -1) if lines[n - 1].strip()), 0)
            if not filled:
                blank += len(lines)
                continue
            if before:
                yield before
            for begin in range(0, blank, BLOCK):
                yield [""] * min(BLOCK, blank - begin)
            before, blank = lines[:filled], len(lines) - filled
        if before:
            before[-1] = before[-1].rstrip()
            yield before
