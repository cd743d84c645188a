"""The page on control models names every format and every function."""

from estimation.controlmodel.formats import FORMATS, OUTPUTS, blocks
from tests.docs.pages import ROOT, codes, table

PAGE = ROOT / "docs/control-model.md"


def _first(heading):
    return [codes(row[0])[0] for row in table(PAGE, heading)]


def test_every_format_has_its_row():
    assert _first("# Control models") == list(FORMATS)


def test_every_signal_has_its_row(palida):
    rows = table(PAGE, "## Signals of the FMU and the S-function")
    assert [name for row in rows for name in codes(row[0])] == [one.name for one in blocks(palida)]


def test_every_output_has_its_row():
    functions = _first("## What the functions return")
    assert [name for name, *_ in OUTPUTS] == functions[: len(OUTPUTS)]
