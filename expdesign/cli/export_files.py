"""README.txt and the record beside the tables of `expdesign export`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from expdesign.export import Export, Task

FOLDER, README = "exports", "README.txt"


def describe(folder: Path, task: Task, made: dict[str, Export], *, keep: bool) -> tuple[Path, Path]:
    """Write README.txt and exports.json; `keep` what they say of other files of the same motion."""
    from expdesign.export import RECORD, file_record, motion_record

    motion = motion_record(task)
    files = _known(folder / RECORD, motion) if keep else {}
    files |= {name: file_record(export) for name, export in made.items()}
    return _written(folder / RECORD, folder / README, motion, files)


def describe_beside(path: Path, task: Task, made: Export) -> tuple[Path, Path]:
    """Write the same of one table beside it, under names that tell whose they are."""
    from expdesign.export import file_record, motion_record, record_of_one

    guide = path.with_name(f"{path.name}.{README}")
    files = {path.name: file_record(made)}
    return _written(record_of_one(path), guide, motion_record(task), files)


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


def _known(record: Path, motion: dict[str, Any]) -> dict[str, Any]:
    from expdesign.export import read_record

    data = read_record(record)
    if data.get("motion") != json.loads(json.dumps(motion)):
        return {}
    return {name: about for name, about in data["files"].items() if (record.parent / name).exists()}
