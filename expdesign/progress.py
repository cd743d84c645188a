"""What a computation is at, told to whoever listens.

As with logging, who computes does not know who listens: `tell` costs next to nothing when nobody
does. What a worker process tells stays in it, but for the events of its jobs: these may be what is
told, for `passed_on`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import TypeVar

T = TypeVar("T")

Told = tuple[str, int, int]
"""What is being done now, how many of its steps are done, and of how many; 0: not known."""
Listener = Callable[[str, int, int], None]
"""Takes the same."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_parts: ContextVar[tuple[str, ...]] = ContextVar("parts", default=())


def tell(what: str, done: int = 0, total: int = 0) -> None:
    """Tell what is being done now, how many of its steps are done, and of how many."""
    listener = _listener.get()
    if listener is not None:
        listener(": ".join((*_parts.get(), what)), done, total)


def told(what: str, items: Sequence[T]) -> Iterator[T]:
    """Yield items, and tell before each how many are done."""
    for done, item in enumerate(items):
        tell(what, done, len(items))
        yield item


@contextmanager
def part(name: str) -> Iterator[None]:
    """Let everything that is told within this begin with a name."""
    before = _parts.set((*_parts.get(), name))
    try:
        yield
    finally:
        _parts.reset(before)


@contextmanager
def told_to(listener: Listener) -> Iterator[None]:
    """Let a listener take what is told within this, without the parts around it."""
    listening, parts = _listener.set(listener), _parts.set(())
    try:
        yield
    finally:
        _listener.reset(listening)
        _parts.reset(parts)


def passed_on() -> Callable[[Told], None]:
    """Return what tells here what another thread or process is at."""
    context = copy_context()
    return lambda told: context.run(tell, *told)
