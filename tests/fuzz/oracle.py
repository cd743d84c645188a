"""What holds of any input: it is used or refused, in few words, and nothing half is left behind."""

import contextlib
import io
import json
import warnings

from expdesign.cli.app import app, run
from expdesign.configuration import ComputationError, InputError

CANARY = "canary-7fd1c0"
"""Stands in files that an input may name and that are none of ours."""

_MOST_LINES = 250
"""Of what is said when an input is refused, as JSON too."""

_LONGEST = 2000
"""Characters of a line of it."""


class BrokenError(AssertionError):
    """What holds of any input does not hold of this one."""


def command(*arguments):
    """Run a command line in this process, and judge it; return its exit status."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            with _warnings_are_errors():
                status = run(app, [str(argument) for argument in arguments])
        except Exception as error:
            raise BrokenError(f"{type(error).__name__}: {error}") from error
    judge(status, out.getvalue(), err.getvalue())
    return status


def call(function, *arguments):
    """Call a function as a command does, and judge it; return the exit status that it leads to."""
    try:
        with _warnings_are_errors():
            function(*arguments)
    except InputError as error:
        status, said = 2, str(error)
    except ComputationError as error:
        status, said = 1, error.message
    except Exception as error:
        raise BrokenError(f"{type(error).__name__}: {error}") from error
    else:
        return 0
    judge(status, "", said)
    return status


@contextlib.contextmanager
def _warnings_are_errors():
    """A warning of Python is for us: a user is told in words."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ResourceWarning)
        # Of starting a copy of this process, which tests do.
        warnings.filterwarnings("ignore", message=".*fork.*", category=DeprecationWarning)
        yield


def judge(status, output, error):
    """Hold status and words of a command against what holds of any."""
    if status not in (0, 1, 2):
        raise BrokenError(f"exit status {status}")
    said = output + error
    for text in ("Traceback", CANARY):
        if text in said:
            raise BrokenError(f"{text} in what is said")
    if status == 0:
        return
    lines = said.splitlines()
    if not lines:
        raise BrokenError("nothing is said")
    if len(lines) > _MOST_LINES or max(map(len, lines)) > _LONGEST:
        raise BrokenError(f"{len(lines)} lines of up to {max(map(len, lines))} characters")


def whole(folder):
    """Refuse files that are half written: those beside their place, and JSON without an end."""
    for path in folder.rglob("*"):
        if path.is_file() and path.name.startswith("."):
            raise BrokenError(f"{path.relative_to(folder)} was left behind")
        if path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
