"""What the tests of six channels have in common, in memory and in a file, and their levels.

A level is the share of sound experiments that each family of tests may reject.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, PlainSerializer, model_serializer

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumbers, described, sized

LACK_OF_FIT = 0.01
"""Over the six actuators."""
CAUSES = 0.02
"""Over all families of causes together."""
POSITION_PERIODIC = 0.001
"""Over six struts and all pitches."""
GAIN_DRIFT = 0.002
"""Over all gains."""
NOISE = 0.001
"""Each of whiteness, normality, outliers and drift, over six channels. Long records show what
matters beyond any doubt; what they hardly show need not alarm anybody."""
CHI_SQUARE = 0.001
"""Over both tails of forces and lengths."""


def _from_one(index: int | None) -> int | None:
    return None if index is None else index + 1


def _from_zero(number: Any) -> Any:
    return number - 1 if isinstance(number, int) else number


Strut = Annotated[
    int | None, BeforeValidator(_from_zero), PlainSerializer(_from_one, return_type=int | None)
]
"""Index of a strut: from 0 in memory, from 1 in a file; None: all of them."""


OfEach = Annotated[OpenNumbers, sized(ACTUATORS)]
"""A number of each channel, of which some may be missing."""


def no_numbers() -> Array:
    """Return what stands in place of six numbers that are not known."""
    return np.full(ACTUATORS, np.nan)


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelTest:
    """Base of the tests of six channels.

    A file has the numbers of the channels that fail; of a test that was not done it has the reason
    and nothing else.
    """

    refused: Annotated[str, described("", "why there is no test; empty when there is one")] = ""
    p_values: Annotated[OfEach, Field(alias="p"), described("1", "of each channel")] = field(
        default_factory=no_numbers
    )
    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of each family of six")
    ] = NOISE

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(6,) channels of which the test rejects the assumption."""
        return below_level(self.p_values, self.level)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels of which the assumption does not hold to an extent that matters."""
        return self.significant

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        if self.refused:
            return {"refused": self.refused}
        return {**fields(self), "failed": (np.flatnonzero(self.failed) + 1).tolist()}


def below_level(p_values: Array, level: float) -> NDArray[np.bool_]:
    """Tell which tests of one family are significant, after Bonferroni."""
    return p_values < level / len(p_values)
