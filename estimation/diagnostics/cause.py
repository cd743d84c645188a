"""A family of candidate causes: columns with their names, a level, and words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.projection import Places
from estimation.diagnostics.signature import Signature
from expdesign.mechanism.catalogue import parameter_unit

Label = tuple[str, int | None]
"""Parameter, or empty, and actuator (from 0; None: all of them)."""

THERE = "the model has the term, or its columns leave nothing to test"
"""Why nothing of a family is left to test."""


@dataclass(frozen=True, eq=False)
class Cause:
    """A family of candidate causes that are tested alike and named in the same words."""

    kind: str
    """Of the effects that are found."""
    labels: tuple[Label, ...]
    """Of the candidates. Those that share one differ in a constant, such as a speed."""
    columns: Signature
    """Of q columns, per SI unit of the effect."""
    level: float
    """Of all its candidates together."""
    assumption: Assumption
    """That there is no such effect."""
    noun: str
    """What such an effect is: ``a constant force``."""
    absent: str
    """The sentence when none was found; a format of `p`, and of `value` and `std` of the most
    significant candidate."""
    untested: str
    """Why there is no test when no column is left."""
    places: tuple[tuple[int, ...], ...] = ()
    """Columns of every candidate; by default one each, in their order."""
    constants: tuple[float, ...] = ()
    """Of every candidate, SI; none by default."""
    at: Callable[[Label, float], Signature] | None = None
    """The columns of a candidate for another constant: where its best value is looked for."""
    sized_by_constant: bool = False
    """The best constant is the size of the effect, such as a delay's of its secant."""
    scale: float = 1.0
    """From SI to the unit shown."""
    number: str = "+.3g"
    """Format of a value."""
    unit: Callable[[str], str] = parameter_unit
    """From the parameter to the unit shown."""
    shown: int | None = None
    """How many of a candidate's values tell its size; None: all."""
    paired: bool = False
    """Values are sine and cosine of one sinusoid after the other: amplitudes tell its size."""
    named: str = "{noun} {place}"
    """How an effect is named that has a place; a format of both."""
    contains: str = ""
    """Kind of the effects that are this one with a part of it zero: no rivals of it."""
    modelled: bool = False
    """Whether the model has a term for it: then nothing is assumed that could fail."""

    @property
    def candidates(self) -> int:
        """How many there are."""
        return len(self.labels)

    def columns_of(self, candidate: int) -> Places:
        """Return the places of a candidate's columns in the family."""
        own = self.places[candidate] if self.places else (candidate,)
        return np.array(own, dtype=np.intp)

    def constant_of(self, candidate: int) -> float:
        """Return a candidate's constant, NaN where the family has none."""
        return self.constants[candidate] if self.constants else np.nan
