"""Figures that are drawn but not rendered: rendering takes longer than most of what is tested."""

from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from matplotlib.figure import Figure

_CONTENT = {
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg" width="7in" height="3in"/>',
    "png": b"\x89PNG\r\n\x1a\n",
    "pdf": b"%PDF-1.4\n",
}


def _save(_figure, path, **settings):
    Path(path).write_bytes(_CONTENT[settings["format"]])


@contextmanager
def blank_figures():
    """Write an empty file for every figure: in this process, for tests that look at none.

    Figures are rendered where they are looked at (tests/results), and end to end by
    tests/cli/test_design.py and in the run folder of tests/report.
    """
    with (
        patch.object(Figure, "savefig", _save),
        patch("results.figures.drawing._lay_out", lambda _figure: None),
    ):
        yield
