"""The way of a run through the modules, as docs/architecture.md tells it, is the one it takes."""

import importlib
import json
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from expdesign.cli.app import app
from expdesign.configuration import load_run
from tests.blank_figures import blank_figures

ROOT = Path(__file__).parents[2]
MOST = 15


def told():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = text.split("## The way of a run")[1].split("\n## ")[0]
    return re.findall(r"^\d+\. `([a-z_/]+\.py)`", section, flags=re.MULTILINE)


@pytest.fixture
def entered(monkeypatch):
    """Collect the modules of ours whose functions are called, in the order of the first call."""
    found = {}

    def watch(frame, event, _argument):
        if event == "call":
            found.setdefault(frame.f_code.co_filename)

    def load(config):
        sys.setprofile(watch)
        return load_run(config)

    # What a module does when it is imported is no step of the way.
    for step in told():
        importlib.import_module(step.removesuffix(".py").replace("/", "."))
    monkeypatch.setattr("expdesign.stages.run.load_run", load)
    yield found
    sys.setprofile(None)


@pytest.mark.slow
def test_the_way_of_a_run(entered, tiny, few_limits, tmp_path, cheap_finish):
    file = tmp_path / "run.yaml"
    run = tiny(robot=few_limits, design={"max_iterations": 4}, report={})
    del run["experiment"]
    file.write_text(json.dumps(run), encoding="utf-8")
    with blank_figures():
        result = CliRunner().invoke(app, ["run", str(file), "--out", str(tmp_path / "out")])
    sys.setprofile(None)
    assert result.exit_code == 0, result.output
    way = [str(Path(name).relative_to(ROOT)) for name in entered if name.startswith(f"{ROOT}/")]
    steps = told()
    # The command, and the run that loads the file, are entered before the watch begins.
    assert steps[:2] == ["expdesign/cli/commands.py", "expdesign/stages/run.py"]
    assert [step for step in way if step in steps[2:]] == steps[2:]
    assert len(steps) <= MOST
