import shutil

import pytest
from typer.testing import CliRunner

from expdesign.cli.app import app
from tests.blank_figures import blank_figures
from tests.tiny_run import run_every_stage

HOSTILE = '<script>alert("x")</script> & "\'</style>'


@pytest.fixture(scope="session")
def whole(tiny_result, made_once):
    """Return a run folder with every stage, made by the command line from a small design.

    Its figures are drawn and not rendered.
    """

    def make(place):
        with blank_figures(filled=True):
            run_every_stage(place / "tiny", title=HOSTILE, design=tiny_result)

    return made_once("report", make) / "tiny"


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
