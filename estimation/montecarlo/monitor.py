"""Watching a study from outside, and stopping it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


class StudyMonitor(Protocol):
    """Sees how far a study is; says when to stop."""

    def advanced(self, done: int, total: int) -> None:
        """Take the number of repetitions that are done, of all that are wanted."""
        ...

    def stop_requested(self) -> bool:
        """Tell whether the study should end with what it has."""
        ...


@dataclass(frozen=True)
class StopRequest:
    """Carries the request to stop to the pool; jobs report nothing but their end."""

    monitor: StudyMonitor | None

    def report(self, event: Any) -> None:
        """Ignore the event."""

    def stop_requested(self) -> bool:
        """Tell whether the study should end with what it has."""
        return self.monitor is not None and self.monitor.stop_requested()
