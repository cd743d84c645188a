"""Robots and runs that ship with the package, as YAML files."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent


def _names(kind: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (_FOLDER / kind).glob("*.yaml")))


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that ship, in alphabetical order."""
    return _names("robots")


def run_names() -> tuple[str, ...]:
    """Return the names of the runs that ship, in alphabetical order."""
    return _names("runs")


def robot_file(name: str) -> Path:
    """Return the file of a robot that ships; `name` is one of `robot_names`."""
    return _FOLDER / "robots" / f"{name}.yaml"


def run_file(name: str) -> Path:
    """Return the file of a run that ships; `name` is one of `run_names`."""
    return _FOLDER / "runs" / f"{name}.yaml"
