"""Hostile inputs by the thousand: files changed at random, seeded, within bounds of CPU, memory."""

import multiprocessing
import os
import resource
import shutil
import signal
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from tests.blank_figures import blank_figures
from tests.fuzz.targets import TARGETS, attempt, seeds_text

TITLE = "hostile files: run, robot, recordings, tables, records, machines"

SECONDS = 20
"""CPU time that one input may take."""

MEMORY = 4 * 2**30
"""Bytes that one input may take beyond what the program has at the beginning."""

KEPT = Path("build") / "soak" / "inputs"


def add_options(parser):
    parser.add_argument("--target", choices=TARGETS, action="append", help="all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--examples", type=int, default=1000, help="inputs of each target")
    parser.add_argument("--number", type=int, help="this input alone")


def run(arguments):
    """Try the inputs; tell those that break something, keep them, and say how to repeat them."""
    first, last = 0, arguments.examples
    if arguments.number is not None:
        first, last = arguments.number, arguments.number + 1
    broken = 0
    for name in arguments.target or TARGETS:
        began = time.perf_counter()
        statuses, slowest, following = Counter(), (0.0, first), first
        while following < last:
            # A process of its own: one that dies tells of its input, and the next goes on.
            for number, status, seconds, reason in _batch(name, arguments.seed, following, last):
                following = number + 1
                statuses[status] += 1
                slowest = max(slowest, (seconds, number))
                if reason:
                    broken += 1
                    print(f"{name} {number}: {reason}")
                    print(f"  kept in {KEPT / f'{name}-{arguments.seed}-{number}'}; again with")
                    print(f"  {seeds_text(name, arguments.seed, number)}", flush=True)
        told = ", ".join(
            f"{count} × {status}" for status, count in sorted(statuses.items(), key=str)
        )
        print(
            f"{name}: {last - first} inputs, exit status {told}; at most {slowest[0]:.1f} s of CPU "
            f"(number {slowest[1]}); {time.perf_counter() - began:.0f} s",
            flush=True,
        )
    return not broken


def _batch(name, seed, first, last):
    """Yield number, status, CPU seconds and what is broken, input by input."""
    number = first
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    place = Path(tempfile.mkdtemp(prefix="soak-"))
    process = context.Process(target=_serve, args=(theirs, place, name, seed, number, last))
    process.start()
    theirs.close()
    try:
        while number < last:
            answer = ours.recv()
            yield answer
            number = answer[0] + 1
    except EOFError:
        process.join()
        reason = f"the process died ({signal.Signals(-process.exitcode).name})"
        _keep(place / str(number), name, seed, number)
        yield number, "died", 0.0, reason
    process.join()
    shutil.rmtree(place)


def _keep(folder, name, seed, number):
    kept = KEPT / f"{name}-{seed}-{number}"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(folder, kept)


def _serve(sink, place, name, seed, first, last):
    signal.signal(signal.SIGVTALRM, _too_long)
    with blank_figures():
        for number in range(first, last):
            sink.send((number, *_one(place / str(number), name, seed, number)))
    sink.close()
    os._exit(0)


def _too_long(*_):
    raise TimeoutError(f"more than {SECONDS} s of CPU")


def _one(folder, name, seed, number):
    folder.mkdir()
    began = _cpu()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    reason = ""
    try:
        status = attempt(name, seed, number, folder)
    except BaseException as error:  # noqa: BLE001 - whatever it is, it is told
        status, reason = "broken", f"{type(error).__name__}: {error}"[:500]
        cause = error.__cause__ or error
        last = traceback.extract_tb(cause.__traceback__)[-1]
        reason += f" [{Path(last.filename).name}:{last.lineno}]"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    if reason:
        _keep(folder, name, seed, number)
    shutil.rmtree(folder)
    return status, _cpu() - began, reason


def _cpu():
    """CPU time of this process and of those that it has waited for, s."""
    return sum(sum(os.times()[k : k + 2]) for k in (0, 2))
