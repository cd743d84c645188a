"""Robots and runs that ship with the package, as YAML files."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent


def robot_files() -> dict[str, Path]:
    """Return the files of the robots that ship by their names, in alphabetical order."""
    return _files("robots")


def run_files() -> dict[str, Path]:
    """Return the files of the runs that ship by their names, in alphabetical order."""
    return _files("runs")


def _files(kind: str) -> dict[str, Path]:
    return dict(sorted((path.stem, path) for path in (_FOLDER / kind).glob("*.yaml")))
