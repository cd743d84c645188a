import pytest

from expdesign.cli.app import app, run
from tests.blank_figures import blank_figures
from tests.remembered import remembered_proofs


@pytest.fixture(scope="module", autouse=True)
def _cheaper():
    with blank_figures(), remembered_proofs():
        yield


@pytest.fixture
def expdesign(capsys):
    """Run a command line in this process; return exit status, standard output and error."""

    def command(*arguments):
        status = run(app, [str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return command
