"""Progress of what is done many times over."""

from __future__ import annotations

import time
from collections.abc import Iterator

from expdesign.cli.output import messages

_HEARTBEAT = 5.0


def counted(numbers: range, what: str) -> Iterator[int]:
    """Go through the numbers and show how far it is, on standard error.

    A terminal gets a bar; elsewhere a line is written, at most every five seconds. A single number
    is not worth a word.

    Parameters
    ----------
    numbers : range
    what : str
        What they count, in the plural.
    """
    total, console = len(numbers), messages()
    if total > 1 and console.is_terminal:
        from rich.progress import track

        yield from track(numbers, description=what, total=total, console=console, transient=True)
        return
    spoke = time.monotonic()
    for done, number in enumerate(numbers):
        if time.monotonic() - spoke > _HEARTBEAT:
            console.print(f"{done} of {total} {what}")
            spoke = time.monotonic()
        yield number
