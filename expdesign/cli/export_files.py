"""README.txt and the record beside the tables of `expdesign export`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from expdesign.cli.output import warn

if TYPE_CHECKING:
    from expdesign.export import Export, Task

FOLDER, README = "exports", "README.txt"


def refuse_taken_name(path: Path, key: str) -> None:
    """Refuse a table under the name of what describes the tables of its folder.

    Raises
    ------
    InputError
        It has such a name.
    """
    from expdesign.configuration import InputError, Problem
    from expdesign.export import RECORD

    taken = (README, RECORD)
    if path.name.casefold() in {name.casefold() for name in taken}:
        raise InputError(
            Problem(
                f"{path.name} is what describes the tables of this folder",
                key=key,
                allowed=f"another name than {' and '.join(taken)}",
            )
        )


def described_files(
    before: dict[str, Any], folder: Path, task: Task, replaced: set[str]
) -> dict[str, Any]:
    """Return what is told of the tables of this motion that are there; warn of those of another.

    Parameters
    ----------
    before : dict
        What exports.json says, or said before outdated files were removed.
    folder : Path
    task : Task
    replaced : set of str
        Names of the tables that are about to be written: of these, nothing is warned.
    """
    from expdesign.export import RECORD, motion_record

    motion = motion_record(task)
    present = {
        name: about for name, about in before.get("files", {}).items() if (folder / name).is_file()
    }
    if before.get("motion") == json.loads(json.dumps(motion)):
        return {name: about for name, about in present.items() if _can_be_told(motion, name, about)}
    if others := sorted(present.keys() - replaced):
        warn(
            f"not of the motion that is exported now, and no longer in {README} and {RECORD}: "
            f"{', '.join(others)}"
        )
    return {}


def describe(folder: Path, task: Task, files: dict[str, Any]) -> tuple[Path, Path]:
    """Write README.txt and exports.json of the tables of a folder."""
    from expdesign.export import RECORD, motion_record

    return _written(folder / RECORD, folder / README, motion_record(task), files)


def describe_beside(path: Path, task: Task, made: Export) -> tuple[Path, Path]:
    """Write the same of one table beside it, under names that tell whose they are.

    Where the table has replaced one of another run's `exports/`, what is said there of the old
    one goes.
    """
    from expdesign.export import RECORD, file_record, motion_record, read_record, record_of_one

    guide = path.with_name(f"{path.name}.{README}")
    files = {path.name: file_record(made)}
    written = _written(record_of_one(path), guide, motion_record(task), files)
    shared = path.with_name(RECORD)
    data = read_record(shared)
    if data.get("files", {}).pop(path.name, None) is not None:
        motion = data["motion"]
        rest = {name: a for name, a in data["files"].items() if _can_be_told(motion, name, a)}
        if rest:
            _written(shared, path.with_name(README), motion, rest)
        else:
            shared.unlink()
            path.with_name(README).unlink(missing_ok=True)
    return written


def export_summary(task: Task, made: list[Export]) -> dict[str, Any]:
    """Return the same for who reads the answer of the command."""
    from expdesign.export import file_record, motion_record

    motion = {key: value for key, value in motion_record(task).items() if key != "ways"}
    return {
        "motion": motion,
        "files": {str(export.path): file_record(export) for export in made},
    }


def _written(
    record: Path, guide: Path, motion: dict[str, Any], files: dict[str, Any]
) -> tuple[Path, Path]:
    from expdesign.export import readme
    from expdesign.runfolder.atomic import write_json, write_text

    write_json(record, {"motion": motion, "files": files})
    write_text(guide, readme(motion, files))
    return record, guide


def _can_be_told(motion: dict[str, Any], name: str, about: Any) -> bool:
    """Tell whether an entry of a record, which may have been changed by hand, is complete."""
    from expdesign.export import readme

    try:
        readme(motion, {name: about})
    except (KeyError, TypeError, ValueError, AttributeError):
        return False
    return True
