"""What a file format is to the reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from estimation.data.table import RawTable
from expdesign.configuration import DataSection


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
        :func:`estimation.data.columns.pick` choose, and loads those. A `InputError` says
        what is wrong; any other exception counts as a damaged file.
    library, extra : str or None
        The optional library that it needs, and by what to install it: ``pip install
        expdesign[extra]``.
    may_crash : bool
        True for a library that can end the process on damaged files: it is read in another one.
    accepts : callable or None
        ``accepts(path)``, for formats that share an extension or are folders; by default the
        extension decides.
    """

    title: str
    extensions: tuple[str, ...]
    read: Callable[[Path, DataSection], RawTable]
    library: str | None = None
    extra: str | None = None
    may_crash: bool = False
    accepts: Callable[[Path], bool] | None = None

    def claims(self, path: Path) -> bool:
        """Tell whether a file or folder that exists is of this format."""
        if self.accepts is not None:
            return self.accepts(path)
        return path.is_file() and path.suffix.lower() in self.extensions
