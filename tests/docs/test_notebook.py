"""The tutorial notebook: its cells run in their order, and their last lines show something."""

import ast
import json

import pytest

from tests.docs.pages import ROOT

NOTEBOOK = ROOT / "docs" / "tutorial.ipynb"


def _show(value):
    """Return what a notebook shows of a value: image, HTML or text."""
    for name in ("_repr_png_", "_repr_html_", "__repr__"):
        if (show := getattr(value, name, None)) is not None:
            return show()
    raise AssertionError("every object has a text")


@pytest.mark.slow
def test_the_cells_run_in_their_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    names, shown = {}, []
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            *lines, last = ast.parse("".join(cell["source"])).body
            exec(compile(ast.Module(lines, []), NOTEBOOK.name, "exec"), names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
                shown.append(_show(value))
            else:
                exec(compile(ast.Module([last], []), NOTEBOOK.name, "exec"), names)
    assert len(shown) == 10
    assert "<b>Design: converged.</b>" in shown[1]
    assert names["design"].passed
    assert names["best"].loc["p10", "ci_low"] < 16.3 < names["best"].loc["p10", "ci_high"]
