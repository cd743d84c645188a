"""Runs that end at a moment of their own, and whether what comes of them is what would have been.

A moment is told by progress, never by the clock: just before a file of the run gets its name for
the n-th time, or before it is opened to be continued.
"""

import json
import os
import re
import signal
import subprocess
import sys
import traceback
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_TIMES = {"seconds", "cpu_seconds", "finished"}
_LEFT_OUT = {"manifest.json"}
_STAMPS = re.compile(
    rb"\d+(\.\d+)?(e-?\d+)?\s*(min|ms|s|h)\b( \d+ (min|s)\b)?"  # how long it took
    rb"|\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?"
    rb"|[0-9a-f]{64}"  # of files that hold how long it took
)


def environment():
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), *(path for path in sys.path if path)]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def ended_at(moment, number, arguments):
    """Run a command that gets a signal at ``(file, n)``, never with None; return how it ended."""
    file, count = moment or ("", 0)
    return subprocess.run(
        [
            *(sys.executable, "-c", "from tests.killed_runs import main; main()"),
            *(file, str(count), str(int(number)), *map(str, arguments)),
        ],
        capture_output=True,
        text=True,
        env=environment(),
        check=False,
    )


def ended_in_copy(moment, number, arguments):
    """Run a command that gets a signal at its moment as a `CopiedRun`; return how it ended."""
    status, said = CopiedRun(arguments, moment=moment, number=number).end()
    return subprocess.CompletedProcess(arguments, status, *said)


class CopiedRun:
    """A command in a copy of this process, which has loaded and built already what a run takes.

    The command line, what is on the disk and how it ends are those of a process of its own; only
    the seconds that one needs before it does anything are saved.
    """

    def __init__(self, arguments, folder=".", moment=None, number=0, prepare=None):
        self.streams = [os.fdopen(os.memfd_create(name), "w+b") for name in ("out", "err")]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # threads: the copy uses none
            self.process = os.fork()
        if self.process == 0:
            os.chdir(folder)
            if prepare is not None:
                prepare()
            _be_the_run(moment, number, arguments, self.streams)

        self.status = None

    def is_running(self):
        if self.status is None:
            process, status = os.waitpid(self.process, os.WNOHANG)
            self.status = status if process else None
        return self.status is None

    def said(self):
        """Return its output and messages so far."""
        found = [os.pread(each.fileno(), 2**24, 0) for each in self.streams]
        return b" ".join(found).decode(errors="replace")

    def end(self):
        """Wait for its end; return its exit status, its output and its messages."""
        if self.status is None:
            _, self.status = os.waitpid(self.process, 0)
        said = []
        for stream in self.streams:
            stream.seek(0)
            said.append(stream.read().decode())
            stream.close()
        return os.waitstatus_to_exitcode(self.status), tuple(said)


def _be_the_run(moment, number, arguments, streams):
    status = 70
    try:
        for place, stream in enumerate(streams, 1):
            os.dup2(stream.fileno(), place)
        sys.stdout, sys.stderr = (open(place, "w", closefd=False) for place in (1, 2))  # noqa: SIM115 - numbers; the process ends with them
        for ending in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(ending, signal.SIG_DFL)
        file, count = moment or ("", 0)
        sys.argv[1:] = [file, str(count), str(int(number)), *map(str, arguments)]
        main()
    except SystemExit as end:
        status = end.code
    except BaseException:  # noqa: BLE001 - the copy must not go on with the tests
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main():
    """Be the run: the command line, with figures that are empty, which ends at its moment."""
    from expdesign.cli import main as command_line
    from tests.blank_figures import blank_figures

    file, count, number, *sys.argv[1:] = sys.argv[1:]
    left = [int(count)]

    def watch(event, arguments):
        if event == "os.rename":
            name = str(arguments[1])
        elif event == "open" and "+" in str(arguments[1]):
            name = str(arguments[0])
        else:
            return
        if left[0] and name.endswith(file):
            left[0] -= 1
            if not left[0]:
                os.kill(os.getpid(), int(number))

    with blank_figures():
        sys.addaudithook(watch)
        command_line()


def contents(folder):
    """Return every file of a run folder by its path, without what differs from run to run."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_file() and name not in _LEFT_OUT:
            found[name] = _timeless(path, folder)
    return found


def _timeless(path, folder):
    data = path.read_bytes().replace(bytes(folder), b"(folder)")
    if path.suffix == ".json":
        return _without_times(json.loads(data))
    if path.suffix == ".html":
        return _STAMPS.sub(b"(time)", data)
    return data


def _without_times(data):
    if isinstance(data, dict):
        return {key: _without_times(value) for key, value in data.items() if key not in _TIMES}
    if isinstance(data, list):
        return [_without_times(item) for item in data]
    return data


def stages(folder):
    """Return the status of every stage in the manifest."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    return {name: entry["status"] for name, entry in manifest["stages"].items()}


def untrue(folder):
    """Return the files that the manifest vouches for and that are not as it says."""
    from expdesign.runfolder.manifest import Manifest, file_hash

    manifest = Manifest.known(folder)
    entries = {} if manifest is None else manifest.stages
    return [
        file
        for name, entry in entries.items()
        if entry.status == "done"
        for file, digest in entry.files.items()
        if not (folder / file).is_file() or file_hash(folder / file) != digest
    ]
