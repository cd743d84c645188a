"""The run folder on the command line: which one it is, and whether it can be written to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration

OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Run folder; runs/<name> by default."),
]


def run_folder(configuration: RunConfiguration, out: Path | None) -> Path:
    """Return the run folder: what the user asked for, or runs/<name> in the current folder."""
    return (out or Path("runs") / configuration.run.name).absolute()


def refuse_unwritable(folder: Path) -> None:
    """Find out before the work, not after it, that its result cannot be written."""
    from tempfile import TemporaryFile

    from expdesign.configuration import InputError, Problem

    existing = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        with TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise InputError(
            [
                Problem(
                    f"cannot write there: {error.strerror}",
                    file=folder,
                    key="--out",
                    allowed="a folder that is new, or may be written to",
                )
            ]
        ) from error
