"""What a stage tells while it goes on, and what it makes or why it failed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from expdesign.configuration import ComputationError, RunConfiguration
from expdesign.progress import Listener, report_progress

if TYPE_CHECKING:
    from expdesign.solver.events import SearchEvent


class Progress:
    """Takes what a run tells. This one ignores it: override what is to be shown."""

    def warn(self, text: str) -> None:
        """Take a warning."""

    def note(self, text: str) -> None:
        """Take a remark: a stage that is kept or left out, what takes long."""

    def finished(self, outcome: Outcome) -> None:
        """Take what a stage has made."""

    @contextmanager
    def search(self, configuration: RunConfiguration) -> Iterator[Callable[[SearchEvent], None]]:
        """Show the search for a design; give what takes its events."""
        del configuration
        yield lambda _event: None

    @contextmanager
    def working(self, what: str) -> Iterator[Listener]:
        """Show what a stage is at while it goes on, by its name; give what takes that."""
        del what
        yield lambda _what, _done, _total: None

    @contextmanager
    def count(self, what: str) -> Iterator[Callable[[int, int], None]]:
        """Show how many of `what` (a plural) are done; give what takes that number and all."""
        yield lambda done, total: report_progress(what, done, total)


def short(path: Path) -> str:
    """Return a path as a user would write it in the current folder."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


class StageFailed(ComputationError):  # noqa: N818 - it is no bug but a result
    """A stage failed, was interrupted, or its result breaks a limit: exit status 1."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a stage made."""

    stage: str = ""
    folder: Path = Path()
    """The run folder."""
    result: Any = None
    """What was computed (a `DesignResult`, a `Twin`, …); None when the stage had been done
    before and was kept."""
    files: tuple[Path, ...] = ()
    """Those that it wrote itself; with none, its record is written and drawn by `do_stage`."""
    summary: dict[str, Any] = field(default_factory=dict)
    """What the command prints with ``--json``, beside the folder and the seconds it took."""
    status: str = "done"
    """As the manifest has it: ``"done"``, ``"limits broken"``, ``"incomplete"`` or
    ``"interrupted"``."""
    message: str = ""
    """One line for the manifest."""
    warnings: tuple[str, ...] = ()
    """Of the result; those of the run file are not among them."""
    doubt: str = ""
    """What speaks against the result, though it is one; an error with ``--strict``."""
    failure: str = ""
    """Why it is no success although files were written; empty when it is one."""
    goes_on: bool = False
    """Whether the stages after it are done all the same where it is no success: it is complete,
    and parts of it failed."""
    asked_to_stop: bool = False
    """Whether an interruption came: a run ends after this stage, however complete that is."""
    record: Any = None
    """The result as its files hold it, for the report; None where there is no type for that."""

    @property
    def kept(self) -> bool:
        """Whether the stage had been done before, from the same inputs."""
        return self.result is None
