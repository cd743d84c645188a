"""The command line `expdesign`."""

import io
import sys


def main() -> None:
    """Run the command line and end the process: the entry point of the console script.

    Exit status 0: done and within limits. 1: failed, or the result breaks a limit. 2: bad input.
    """
    from expdesign.cli.app import app
    from expdesign.cli.errors import run

    for stream in (sys.stdout, sys.stderr):
        # A terminal without Greek letters shows codes in their place.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.exit(run(app, sys.argv[1:]))
