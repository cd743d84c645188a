"""What the tests of six channels have in common, in memory and in a file."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, PlainSerializer, model_serializer

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS


def _from_one(index: int | None) -> int | None:
    return None if index is None else index + 1


def _from_zero(number: Any) -> Any:
    return number - 1 if isinstance(number, int) else number


Strut = Annotated[
    int | None, BeforeValidator(_from_zero), PlainSerializer(_from_one, return_type=int | None)
]
"""Index of a strut: from 0 in memory, from 1 in a file; None: all of them."""


def no_numbers() -> Array:
    """Return what stands in place of six numbers that are not known."""
    return np.full(ACTUATORS, np.nan)


class ChannelTest:
    """Base of the tests of six channels; a file has the numbers of those that fail.

    Attributes
    ----------
    p_values : (6,)
    level : float
        Of the family of six.
    refused : str
        Why the test was not done, in which case a file says nothing else; empty when it was.
    """

    p_values: Array
    level: float
    refused: str = ""

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels of which the assumption does not hold."""
        return self.p_values < self.level / len(self.p_values)

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        if self.refused:
            return {"refused": self.refused}
        return {**fields(self), "failed": (np.flatnonzero(self.failed) + 1).tolist()}
