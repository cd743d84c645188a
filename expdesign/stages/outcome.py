"""What a stage makes, or why it failed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from expdesign.configuration import ComputationError


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
    """Those that it wrote; those of the record are written by who asked for the stage."""
    summary: dict[str, Any] = field(default_factory=dict)
    """What the command prints with ``--json``, beside the folder and the seconds it took."""
    status: str = "done"
    """As the manifest has it: ``"done"``, ``"limits broken"`` or ``"interrupted"``."""
    message: str = ""
    """One line for the manifest."""
    warnings: tuple[str, ...] = ()
    """Of the result; those of the run file are not among them."""
    doubt: str = ""
    """What speaks against the result, though it is one; an error with ``--strict``."""
    failure: str = ""
    """Why it is no success although files were written; empty when it is one."""
    record: Any = None
    """The result as its files hold it, for the report; None where there is no type for that."""

    @property
    def kept(self) -> bool:
        """Whether the stage had been done before, from the same inputs."""
        return self.result is None
