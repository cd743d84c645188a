"""`exports.json`, or ``<table>.json`` beside a table: what the tables are, for programs."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from expdesign.export.definition import Task
from expdesign.export.exporting import Export
from expdesign.export.read_back import LIMIT_SHARE, LOG_DET_CHANGE, STD_SHARE, limits_in_words
from expdesign.export.row_times import SHARE
from expdesign.motion import motion_to_record

RECORD = "exports.json"

_COORDINATES = ("x", "y", "z", "phi", "theta", "psi")


def record_of_one(path: Path) -> Path:
    """Return where the record of a table stands that is in a folder of the user's."""
    return path.with_name(f"{path.name}.json")


def read_record(path: Path) -> dict[str, Any]:
    """Return a record; empty when there is none, or none that can be used."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    parts = ("motion", "files")
    known = isinstance(data, dict) and all(isinstance(data.get(part), dict) for part in parts)
    return data if known else {}


def motion_record(task: Task) -> dict[str, Any]:
    """Return what the record says of the motion."""
    first, last = task.motion.window
    return {
        "name": task.name,
        "robot": task.robot.name,
        "units": "SI and radians, unless stated",
        "duration": task.motion.duration,
        "window": [first, last],
        "periods": task.motion.periods,
        "period": task.motion.trajectory.period,
        "sampling": task.sampling,
        "controller_period": task.controller_period,
        "home": task.robot.home.tolist(),
        "made_from": task.made_from,
        "ways": motion_to_record(task.motion),
    }


def file_record(export: Export) -> dict[str, Any]:
    """Return what the record says of a file."""
    settings, check = export.settings, export.check
    form, axes = settings.form, settings.axes
    moved = _COORDINATES if axes.space == "pose" else tuple(f"q{j}" for j in range(1, 7))
    step = f"{1e3 * check.longest:.6g} ms"
    guide = form.guide.format(axes=", ".join(axes.names), step=step, file=export.path.name)
    off = check.deviation
    return {
        "sha256": export.digest,
        "format": form.name,
        "title": form.title,
        "guide": guide,
        "axes": [
            {"name": name, "unit": unit, "moves": moved[source], "start": float(start)}
            for name, unit, source, start in zip(
                axes.names, axes.units, axes.source, settings.start, strict=True
            )
        ],
        "options": settings.section.model_dump(exclude_none=True),
        "digits": settings.digits,
        "rows": check.rows,
        "shortest_step": check.shortest,
        "longest_step": check.longest,
        "duration": check.duration,
        "interpolation": form.interpolation.value,
        "read_back": {
            "points": check.points,
            "row_error": check.row_error,
            "position_error": off.position,
            "velocity_error": off.velocity,
            "acceleration_error_share": off.acceleration,
            "force_error_share": off.force,
            "limits": {
                limit.key: {
                    "value": limit.value,
                    "bound": limit.bound,
                    "unit": limit.unit,
                    "row": limit.row,
                    "time": limit.time,
                    "violation": limit.violation,
                    "tolerance": LIMIT_SHARE,
                    "kept": limit.kept,
                }
                for limit in check.limits
            },
            "limits_in_words": limits_in_words(check.limits),
            "information": None if check.information is None else asdict(check.information),
            "tolerances": {
                "position": settings.tolerance,
                "acceleration_and_force_share": SHARE,
                "limit_share": LIMIT_SHARE,
                "log_det": LOG_DET_CHANGE,
                "std_share": STD_SHARE,
            },
        },
    }
