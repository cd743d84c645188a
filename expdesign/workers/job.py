"""A job: a function of picklable data, done with what its process has built once."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from expdesign.configuration import ComputationError


@dataclass(frozen=True)
class Monitor:
    """What a search or a study reports to, and asks whether to stop; by default nobody.

    Anything with the functions that are called does as well.
    """

    stop_requested: Callable[[], bool] = lambda: False
    """Whether the work should end with what it has."""
    report: Callable[[Any], None] = lambda _event: None
    """Takes one event, of whatever kind the jobs report."""
    advanced: Callable[[int, int], None] = lambda _done, _total: None
    """Takes how many repetitions are done, of all that are wanted."""


class StoppedError(ComputationError):
    """A stop was requested before there was anything that could be kept."""


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
