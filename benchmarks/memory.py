"""Largest memory of this process and all its descendants, sampled from /proc."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_INTERVAL = 0.5


@contextmanager
def largest_memory() -> Iterator[list[float]]:
    """Give a list whose last item is the largest sum of resident memory so far, GiB."""
    found, done = [0.0], threading.Event()

    def sample() -> None:
        while not done.wait(_INTERVAL):
            found.append(max(found[-1], _resident(_tree())))

    thread = threading.Thread(target=sample, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        done.set()
        thread.join()


def _tree() -> list[str]:
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[status.parent.name] = status.read_text().rsplit(")", 1)[1].split()[1]
        except OSError:  # it ended meanwhile
            continue
    tree = [Path("/proc/self").resolve().name]
    for process in tree:
        tree += [child for child, parent in parents.items() if parent == process]
    return tree


def _resident(processes: list[str]) -> float:
    total = 0
    for process in processes:
        try:
            lines = Path(f"/proc/{process}/status").read_text().splitlines()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
    return total / 2**20
