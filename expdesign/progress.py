"""Progress reports of a computation, passed to a listener.

As with logging, the code that computes does not know the listener, and `report_progress` costs
next to nothing without one. The jobs of a worker process send their reports as events, and
`forward_progress` passes them on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import TypeVar

T = TypeVar("T")

ProgressReport = tuple[str, int, int]
"""Activity, number of steps that are done, and their total (0: unknown)."""
Listener = Callable[[str, int, int], None]
"""Receives the activity, the steps that are done and their total."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_prefixes: ContextVar[tuple[str, ...]] = ContextVar("parts", default=())


def report_progress(what: str, done: int = 0, total: int = 0) -> None:
    """Report the current activity, the steps that are done and their total (0: unknown)."""
    listener = _listener.get()
    if listener is not None:
        listener(": ".join((*_prefixes.get(), what)), done, total)


def track(what: str, items: Sequence[T]) -> Iterator[T]:
    """Yield items and report before each how many are done."""
    for done, item in enumerate(items):
        report_progress(what, done, len(items))
        yield item


@contextmanager
def progress_prefix(name: str) -> Iterator[None]:
    """Prefix every report within this context with a name."""
    before = _prefixes.set((*_prefixes.get(), name))
    try:
        yield
    finally:
        _prefixes.reset(before)


@contextmanager
def listen_to_progress(listener: Listener) -> Iterator[None]:
    """Pass all reports within this context to a listener, without outer prefixes."""
    outer, prefixes = _listener.set(listener), _prefixes.set(())
    try:
        yield
    finally:
        _listener.reset(outer)
        _prefixes.reset(prefixes)


def forward_progress() -> Callable[[ProgressReport], None]:
    """Return a function that reports here the progress of another thread or process."""
    context = copy_context()
    return lambda report: context.run(report_progress, *report)
