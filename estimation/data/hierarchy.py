"""Arrays in structs and groups as named columns: what MATLAB and HDF5 files have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import Column

NUMERIC = "biuf"
"""Kinds of dtypes that are numbers."""

_MOST_COLUMNS = 256


@dataclass(frozen=True)
class Leaf:
    """An array in a file.

    Attributes
    ----------
    name, short : str
        Its name with and without the structs or groups that it is in.
    place : hashable
        By what the reader finds it.
    """

    name: str
    short: str
    shape: tuple[int, ...]
    place: Any
    unit: str | None = None


def leaf_columns(leaf: Leaf) -> Iterator[Column]:
    """Yield the columns of an array: a vector is one, a matrix ``m`` has ``m(:,1)``, ``m(:,2)`` ….

    Axes of length one do not count; the longer axis of a matrix is time. Scalars and arrays of
    more axes have no columns.
    """
    long = [size for size in leaf.shape if size != 1]
    if len(long) == 1:
        yield Column(leaf.name, (leaf.place, None), short=leaf.short, unit=leaf.unit)
    elif len(long) == 2 and min(long) <= _MOST_COLUMNS:  # noqa: PLR2004 - a matrix
        for k in range(min(long)):
            yield Column(
                f"{leaf.name}(:,{k + 1})",
                (leaf.place, k),
                short=f"{leaf.short}(:,{k + 1})",
                unit=leaf.unit,
            )


def load_columns(
    picked: Mapping[str, Column], load: Callable[[Any], NDArray[Any]]
) -> dict[str, Array]:
    """Return the numbers of the columns that were picked; each array is loaded once.

    Parameters
    ----------
    picked : mapping
        Channel → column from `leaf_columns`.
    load : callable
        Place of a leaf → its array.
    """
    loaded: dict[Any, NDArray[Any]] = {}
    values = {}
    for channel, column in picked.items():
        place, k = column.place
        if place not in loaded:
            array = np.squeeze(load(place))
            loaded[place] = array.T if array.ndim > 1 and array.shape[1] > array.shape[0] else array
        array = loaded[place] if k is None else loaded[place][:, k]
        values[channel] = np.ascontiguousarray(array, dtype=np.float64)
    return values
