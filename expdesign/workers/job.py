"""A job: a function of picklable data, done with what its process has built once."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from threadpoolctl import threadpool_limits


class Monitor(Protocol):
    """Takes the events that jobs report; says when to stop."""

    def report(self, event: Any) -> None:
        """Take one event, of whatever kind the jobs report."""

    def stop_requested(self) -> bool:
        """Tell whether the work should end with what it has."""


class SilentMonitor:
    """Takes every event and never stops."""

    def report(self, event: Any) -> None:
        """Ignore the event."""

    def stop_requested(self) -> bool:
        """Never."""
        return False


@dataclass(frozen=True)
class Job:
    """A call ``function(built, monitor, *arguments)``; function and arguments are picklable."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def run(self, recipe: bytes, monitor: Monitor) -> Any:
        """Do it with one BLAS thread, and with what the pickled recipe builds in this process."""
        with threadpool_limits(1):
            return self.function(_built_from(recipe), monitor, *self.arguments)


_built: dict[str, Any] = {}


def _built_from(recipe: bytes) -> Any:
    """Build once per process; what the last recipe built stays."""
    key = hashlib.sha256(recipe).hexdigest()
    if key not in _built:
        _built.clear()
        _built[key] = pickle.loads(recipe)()
    return _built[key]
