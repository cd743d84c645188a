"""What a file format is to the reader."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimation.data.table import RawTable
from expdesign.configuration import ConfigurationError, Problem
from expdesign.schema import DataSection


@dataclass(frozen=True)
class FileFormat:
    """A format that measurements come in: one file of :mod:`estimation.data.readers`.

    Attributes
    ----------
    title : str
        For messages and the documentation.
    extensions : tuple of str
        Lower case, with the dot.
    read : callable
        ``read(path, section)``: lists the columns of the file, has
        :func:`estimation.data.columns.pick` choose, and loads those. A `ConfigurationError` says
        what is wrong; any other exception counts as a damaged file.
    extra : str or None
        The optional dependency that it needs: ``pip install expdesign[extra]``.
    accepts : callable or None
        ``accepts(path)``, for formats that share an extension or are folders; by default the
        extension decides.
    """

    title: str
    extensions: tuple[str, ...]
    read: Callable[[Path, DataSection], RawTable]
    extra: str | None = None
    accepts: Callable[[Path], bool] | None = None

    def claims(self, path: Path) -> bool:
        """Tell whether a file or folder that exists is of this format."""
        if self.accepts is not None:
            return self.accepts(path)
        return path.is_file() and path.suffix.lower() in self.extensions


def optional_module(name: str, extra: str, path: Path) -> Any:
    """Import a library that only one format needs.

    Raises
    ------
    ConfigurationError
        It is not installed: how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        library = name.partition(".")[0]
        raise ConfigurationError(
            Problem(
                f"this format is read with {library}, which is not installed",
                path,
                allowed=f"after: pip install expdesign[{extra}]",
            )
        ) from None
