import shutil

import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from expdesign.cli.app import app
from expdesign.experiment import DesignRecord

HOSTILE = '<script>alert("x")</script> & "\'</style>'


@pytest.fixture(scope="session")
def whole(tiny, tiny_result, made_once):
    """Return a run folder with every stage, made by the command line from a small design."""
    return made_once("report", lambda place: _whole(tiny, tiny_result, place)) / "tiny"


def _whole(tiny, tiny_result, place):
    folder = place / "tiny"
    DesignRecord.of(tiny_result).write(folder)
    run = tiny(
        description=f"All stages of {HOSTILE}",
        experiment={"seed": 3},
        estimate={"estimators": ["gm", "ml"]},
        validate=[{"motion": "circle", "periods": 3}],
        montecarlo={"repetitions": 3, "estimators": ["ls"]},
        report={"title": f"Report of {HOSTILE}", "figures": ["svg"]},
    )
    del run["design"], run["trajectory"]
    run["trajectory"] = tiny()["trajectory"]
    file = folder.parent / "run.yaml"
    with file.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(run, stream)
    found = CliRunner().invoke(app, ["run", str(file), "--out", str(folder)])
    assert found.exit_code == 0, (found.output, found.exception)


@pytest.fixture
def folder(whole, tmp_path):
    """Give each test its own copy of the run folder."""
    shutil.copytree(whole, tmp_path / "tiny")
    return tmp_path / "tiny"


@pytest.fixture
def expdesign_says():
    """Return a way to call the command line: exit status and what it wrote.

    With --json what it wrote is the answer, without the progress that a slow machine shows.
    """

    def call(*arguments):
        found = CliRunner().invoke(app, [str(argument) for argument in arguments])
        said = found.stdout if "--json" in arguments else found.output
        return found.exit_code, said, found.exception

    return call
