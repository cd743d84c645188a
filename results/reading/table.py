"""CSV tables: the columns that are asked for, as texts or numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem
from expdesign.runfolder import MissingFileError

_HEADER_LINES = 2
"""The first row of a table stands in the file's second line."""


@dataclass(frozen=True, eq=False)
class Table:
    """A table as it stands in its file.

    Attributes
    ----------
    path : Path
    columns : mapping of str to tuple of str
        Cells by the column's name.
    """

    path: Path
    columns: Mapping[str, tuple[str, ...]]

    @classmethod
    def read(cls, path: Path, required: Iterable[str], optional: Iterable[str] = ()) -> Table:
        """Read a table; columns that are not asked for are left out.

        Parameters
        ----------
        path : Path
        required, optional : iterable of str
            Names of columns.

        Raises
        ------
        MissingFileError
            There is no such file.
        InputError
            It is no table, or columns are missing.
        """
        if not path.is_file():
            raise MissingFileError(path, "what `expdesign` wrote into a run folder")
        try:
            frame = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8")
        except (OSError, ValueError) as error:
            raise InputError(Problem(f"not a table that can be read: {error}", path)) from error
        missing = [name for name in required if name not in frame.columns]
        if missing:
            raise InputError(Problem(f"columns are missing: {', '.join(missing)}", path))
        wanted = [*required, *(name for name in optional if name in frame.columns)]
        return cls(path, {name: tuple(frame[name]) for name in wanted})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def numbers(self, name: str, *, blank: bool = False) -> Array:
        """Return a column as numbers, (N,).

        Parameters
        ----------
        name : str
        blank : bool
            True where an empty cell, "nan" or "inf" may stand; an empty cell is NaN.

        Raises
        ------
        InputError
            A cell is no number, or not a finite one.
        """
        cells = self.columns[name]
        try:
            values = np.array([float(cell) if cell or not blank else np.nan for cell in cells])
        except ValueError:
            bad = next(k for k, cell in enumerate(cells) if not _is_number(cell, blank))
            raise self._bad(name, bad) from None
        if not blank and not np.all(np.isfinite(values)):
            raise self._bad(name, int(np.flatnonzero(~np.isfinite(values))[0]))
        return values

    def block(self, names: Iterable[str]) -> Array:
        """Return columns side by side as finite numbers, (N, k)."""
        return np.column_stack([self.numbers(name) for name in names])

    def _bad(self, name: str, row: int) -> InputError:
        line, cell = row + _HEADER_LINES, self.columns[name][row]
        return InputError(
            Problem(f"expected a number, not {cell!r}", self.path, line, f"column {name}")
        )


def _is_number(cell: str, blank: bool) -> bool:
    try:
        float(cell)
    except ValueError:
        return blank and not cell
    return True
