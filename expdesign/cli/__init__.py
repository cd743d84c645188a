"""The command line `expdesign`."""

import contextlib
import gc
import io
import os
import signal
import sys
from typing import Any

_FAILED = 1
_OBJECTS = 50_000
"""New objects after which Python searches for unused cycles; with its usual 700 the search takes a
tenth of the time of imports and figures."""
_SHOW_CURSOR = b"\x1b[?25h"


def main() -> None:
    """Run the command line and end the process: the entry point of the console script.

    Exit status 0: done and within limits. 1: failed, interrupted, or the result breaks a limit.
    2: bad input. SIGTERM and SIGHUP interrupt as Ctrl-C does.
    """
    gc.set_threshold(_OBJECTS, *gc.get_threshold()[1:])
    usual = signal.getsignal(signal.SIGINT)
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)
    from expdesign.interruption import (
        has_raised,
        ignore_interruptions,
        raise_interruptions,
        without_interruptions,
    )

    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, usual)
    try:
        with raise_interruptions(_end_at_once):
            status = _run()
    except KeyboardInterrupt:
        with without_interruptions():
            _say_interrupted()
        status = _FAILED
    ignore_interruptions()
    if has_raised():
        # An exception that went through code in a text lets Python end itself by a signal later on.
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _end_at_once(*_signal: Any) -> None:
    _say_interrupted()
    os._exit(_FAILED)


def _say_interrupted() -> None:
    """Say so with nothing that would have to be imported first."""
    with contextlib.suppress(OSError):
        if "--json" in sys.argv:
            os.write(1, b'{\n  "status": 1,\n  "message": "interrupted"\n}\n')
            return
        if os.isatty(2):
            os.write(2, _SHOW_CURSOR)  # a bar may have hidden it
        os.write(2, b"failed: interrupted\n")


def _run() -> int:
    """Run the command line; return its exit status."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        # A terminal without Greek letters shows codes in their place.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.stderr = _undemanding(sys.stderr)

    from expdesign.cli.app import app, run

    status = run(app, sys.argv[1:])
    try:
        sys.stdout.flush()
    except OSError as error:
        sys.stderr.write(f"failed: standard output: {error.strerror}\n")
        # The rest of the output would fail again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        status = status or _FAILED
    return status


class _Undemanding(io.FileIO):
    """Output stream that ignores errors, so that a run continues when its terminal is closed."""

    def write(self, data: Any, /) -> int:
        """Write, if possible."""
        try:
            return super().write(data)
        except OSError:
            return len(memoryview(data).cast("B"))


def _undemanding(stream: Any) -> Any:
    """Return a stream for the same messages that does not fail."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # Python may use no buffer
    if type(raw) is not io.FileIO or not isinstance(stream, io.TextIOWrapper):
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(_Undemanding(raw.fileno(), "w", closefd=False)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=True,
    )
