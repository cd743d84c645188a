"""`tables/eigenvalues.csv`: eigenvalues of the scaled information matrix."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from results.reading.table import Table

_NOMINAL = "eigenvalue_nominal"


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues of F in its scalings, ascending.

    Attributes
    ----------
    columns : (m,)
        Of F with unit diagonal.
    nominal : (m,) or None
        Of F scaled by the nominal parameters; None when the table does not have them.
    """

    columns: Array
    nominal: Array | None

    @classmethod
    def read(cls, path: Path) -> Spectrum:
        """Read the file.

        Raises
        ------
        RunFolderError
            It is missing or no such table.
        """
        table = Table.read(path, ["index", "eigenvalue"], [_NOMINAL])
        order = np.argsort(table.numbers("index"), kind="stable")
        nominal = table.numbers(_NOMINAL, blank=True)[order] if _NOMINAL in table else None
        if nominal is not None and not np.any(np.isfinite(nominal)):
            nominal = None
        return cls(table.numbers("eigenvalue")[order], nominal)
