"""A page whose commands are run: its steps in their order, and the numbers that it states.

A YAML block whose first line is a comment with a file name is a file, a `bash` block contains
commands, a `python` block is a script, a `text` block an excerpt of the output of the commands
before it: its lines in their order, `…` for omissions. A number in the prose or a table is
followed by a comment with its source:

    16.4<!-- estimates.csv ml p10 value --> kg
    0.10<!-- noise.json length_std 5 * 1000 --> mm

the file in the run folder, then the first cells of a row of a table and the column, or the keys of
a document; blanks in them are written as underscores. Numbers agree when they differ by no more
than one in the last digit that the page shows: the last digits of an optimum are the machine's.
"""

import csv
import json
import re
from dataclasses import dataclass

from tests.docs.pages import fences

_NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?"
_STATED = re.compile(
    rf"(?P<shown>{_NUMBER})<!-- (?P<source>\S+) (?P<place>[^*]+?)(?: \* (?P<factor>\S+))? -->"
)
_FRAME = re.compile(r"[\u2500-\u257f]+")
OMITTED = "…"


@dataclass(frozen=True)
class Step:
    """A fence of the page: `kind` is `file`, `command`, `script` or `output`."""

    kind: str
    text: str
    name: str = ""


@dataclass(frozen=True)
class Stated:
    """A number of the page and where it comes from."""

    shown: str
    source: str
    place: tuple[str, ...]
    factor: float


def steps(page):
    """Return files, commands and outputs of a page in their order."""
    found = []
    for block in fences(page):
        if block.language == "yaml":
            first = block.text.partition("\n")[0]
            if first.startswith("# ") and first.endswith(".yaml"):
                found.append(Step("file", block.text, first.removeprefix("# ")))
        elif block.language == "bash":
            lines = block.text.replace("\\\n", "").splitlines()
            found += [Step("command", line) for line in lines]
        elif block.language == "python":
            found.append(Step("script", block.text))
        else:
            assert block.language == "text", f"{page.name}: unknown block {block.language}"
            found.append(Step("output", block.text))
    return found


def stated_numbers(page):
    """Return the numbers of a page with their sources."""
    text = page.read_text(encoding="utf-8")
    found = [
        Stated(m["shown"], m["source"], tuple(m["place"].split()), float(m["factor"] or 1))
        for m in _STATED.finditer(text)
    ]
    assert len(found) == text.count("<!-- "), f"{page.name}: an unknown comment"
    return found


def agree(shown, true):
    """Return whether a number of the page agrees with the program within its last digit."""
    mantissa, _, exponent = shown.partition("e")
    decimals = len(mantissa.partition(".")[2])
    last = 10.0 ** (int(exponent or 0) - decimals)
    return abs(float(shown) - true) <= last * (1 + 1e-9)


def value_of(stated, folder):
    """Return the value in a run folder of a number of the page."""
    file = folder / stated.source
    if file.suffix == ".json":
        found = json.loads(file.read_text(encoding="utf-8"))
        for key in stated.place:
            found = found[int(key) if isinstance(found, list) else key]
        return stated.factor * float(found)
    *chosen, column = stated.place
    with file.open(encoding="utf-8", newline="") as stream:
        lines = [[cell.replace(" ", "_") for cell in line] for line in csv.reader(stream)]
    rows = [line for line in lines[1:] if line[: len(chosen)] == chosen]
    assert len(rows) == 1, f"{file}: {len(rows)} rows with {chosen}"
    return stated.factor * float(rows[0][lines[0].index(column)])


def missing_line(excerpt, output):
    """Return the first line of an excerpt that the output lacks, None if it lacks none.

    Frames of tables and the width of blanks do not count.
    """
    left = iter(_plain(output))
    for line in _plain(excerpt):
        if line != OMITTED and not any(_same(line, other) for other in left):
            return line
    return None


def _plain(text):
    lines = (" ".join(_FRAME.sub(" ", line).split()) for line in text.splitlines())
    return [line for line in lines if line]


def _same(line, other):
    words, others = line.split(), other.split()
    if words[-1] == OMITTED:
        # The end of the line is left out.
        words, others = words[:-1], others[: len(words) - 1]
    return len(words) == len(others) and all(map(_same_word, words, others))


def _same_word(word, other):
    if word == OMITTED:
        return True
    if re.sub(_NUMBER, "#", word) != re.sub(_NUMBER, "#", other):
        return False
    pairs = zip(re.findall(_NUMBER, word), re.findall(_NUMBER, other), strict=True)
    # A whole number of the program is a count.
    return all(
        one == two if two.lstrip("-").isdigit() and "." not in one else agree(one, float(two))
        for one, two in pairs
    )
