"""`estimate.select:` terms of the dynamics that the data may add to the robot's."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.parameters import FurtherTerms
from expdesign.configuration.problem import refusal, require
from expdesign.configuration.section import Section
from expdesign.configuration.values.quantity import Number
from expdesign.configuration.values.scalars import one_of

SelectionCriterion = Literal["bic", "f", "holdout"]

_LEVEL_SHARE = require(
    lambda value: 0 < value < 1, "{value:g} is no level of a test", "0 < level < 1, such as 0.01"
)
DEFAULT_LEVEL = 0.01


class SelectSection(Section):
    """Terms that the robot may lack, of which the data choose."""

    candidates: FurtherTerms
    """As in a robot file's `terms`."""
    by: Annotated[SelectionCriterion, one_of(SelectionCriterion)] = "bic"
    """What judges a step: Schwarz's criterion, an F test, or forces that were not fitted."""
    level: Annotated[Number, _LEVEL_SHARE] | None = None
    """Of the F tests: how often one of all candidates enters though none belongs there; None:
    `DEFAULT_LEVEL`, where `by` is `f`."""

    @model_validator(mode="after")
    def _level_of_a_test(self) -> SelectSection:
        if self.level is not None and self.by != "f":
            raise refusal(f"by: {self.by} has no level", "level with by: f alone", key="level")
        return self
