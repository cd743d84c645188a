"""`design.json`: what the design came to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from results.errors import MissingFileError, RunFolderError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DesignSummary:
    """The numbers of `design.json` that results show.

    Attributes
    ----------
    criterion, scaling, status : str
    harmonics : int
    omega : float
        rad/s.
    lambda0 : (6,)
        m, rad.
    mu, nu : (6, n)
        m/s, rad/s.
    samples : int
        Samples of one period in the information.
    samples_per_period : float
        Controller steps of one period, a whole number wherever one fits the frequency's range.
    log_det_information, criterion_value : float or None
        None when the information matrix is singular.
    experiment_samples : int
    experiment_periods : float
        What the standard deviations of the experiment are predicted for.
    best_start : int or None
        The start that the design came from.
    warnings : tuple of str
    """

    criterion: str
    scaling: str
    status: str
    harmonics: int
    omega: float
    lambda0: Array
    mu: Array
    nu: Array
    samples: int
    samples_per_period: float
    log_det_information: float | None
    criterion_value: float | None
    experiment_samples: int
    experiment_periods: float
    best_start: int | None
    warnings: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> DesignSummary:
        """Read the file; keys that are not known are left alone.

        Raises
        ------
        RunFolderError
            It is missing, no JSON, or a key is missing or of the wrong kind.
        """
        if not path.is_file():
            raise MissingFileError(path)
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise RunFolderError(path, f"not JSON that can be read: {error}") from error
        top = _Section(path, "", document)
        experiment = top.section("predicted_std").section("experiment")
        harmonics = top.integer("harmonics")
        best = top.section("solver").optional("best_start")
        return cls(
            criterion=top.text("criterion"),
            scaling=top.text("scaling"),
            status=top.text("status"),
            harmonics=harmonics,
            omega=top.number("omega"),
            lambda0=top.array("lambda0", (6,)),
            mu=top.array("mu", (6, harmonics)),
            nu=top.array("nu", (6, harmonics)),
            samples=top.integer("samples"),
            samples_per_period=top.number("samples_per_period"),
            log_det_information=top.number_or_none("log_det_information"),
            criterion_value=top.number_or_none("criterion_value"),
            experiment_samples=experiment.integer("samples"),
            experiment_periods=experiment.number("periods"),
            best_start=None if best is None else int(best),
            warnings=tuple(str(warning) for warning in top.optional("warnings") or ()),
        )


class _Section:
    """A mapping of the document that says where it stands when something is wrong."""

    def __init__(self, path: Path, key: str, data: object) -> None:
        self._path, self._key = path, key
        if not isinstance(data, dict):
            raise RunFolderError(path, f"{key or 'the document'}: expected a mapping")
        self._data: Mapping[str, Any] = data

    def optional(self, key: str) -> Any:
        return self._data.get(key)

    def section(self, key: str) -> _Section:
        return _Section(self._path, self._name(key), self._get(key))

    def text(self, key: str) -> str:
        value = self._get(key)
        if not isinstance(value, str):
            raise self._wrong(key, "a text", value)
        return value

    def integer(self, key: str) -> int:
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._wrong(key, "a whole number", value)
        return value

    def number(self, key: str) -> float:
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise self._wrong(key, "a finite number", value)
        return float(value)

    def number_or_none(self, key: str) -> float | None:
        return None if self._get(key) is None else self.number(key)

    def array(self, key: str, shape: tuple[int, ...]) -> Array:
        value = self._get(key)
        expected = f"{' × '.join(map(str, shape))} finite numbers"
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise self._wrong(key, expected, value) from None
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise self._wrong(key, expected, value)
        return array

    def _get(self, key: str) -> Any:
        if key not in self._data:
            raise RunFolderError(self._path, f"the key {self._name(key)} is missing")
        return self._data[key]

    def _name(self, key: str) -> str:
        return f"{self._key}.{key}" if self._key else key

    def _wrong(self, key: str, expected: str, value: object) -> RunFolderError:
        shown = repr(value)
        shown = shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}…"
        return RunFolderError(self._path, f"{self._name(key)}: expected {expected}, not {shown}")


_LONGEST = 60
