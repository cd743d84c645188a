"""Figures that are not rendered, nor drawn: both take longer than most of what is tested."""

from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

from matplotlib.figure import Figure

from results.figures.drawing import FigureDefinition

_CONTENT = {
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg" width="7in" height="3in"/>',
    "png": b"\x89PNG\r\n\x1a\n",
    "pdf": b"%PDF-1.4\n",
}


def _save(_figure, path, **settings):
    Path(path).write_bytes(_CONTENT[settings["format"]])


@contextmanager
def blank_figures(*, filled=False):
    """Write an empty file for every figure: in this process, for tests that look at none.

    Filled ones are drawn and not rendered. Figures are drawn and looked at in tests/results, and
    drawn of whole runs by tests/docs/test_tutorial.py and for the run folder of tests/report; with
    rendering by tests/cli/test_design.py and tests/report/test_browser.py.
    """
    with ExitStack() as patched:
        patched.enter_context(patch.object(Figure, "savefig", _save))
        patched.enter_context(patch("results.figures.drawing._lay_out", lambda _figure: None))
        if not filled:
            empty = patch.object(FigureDefinition, "draw", lambda *_: Figure())
            patched.enter_context(empty)
        yield
