"""The delay between the channels of lengths and forces that fits best: one Gauss–Newton step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_serializer

from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.levels import DELAY
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.tails import log_two_sided
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class DelayTest:
    """By how much the forces lag behind the lengths, beyond the delays that were given."""

    refused: Annotated[str, described("", "why there is no test; empty when there is one")]
    delay: Annotated[
        OpenNumber, Field(alias="seconds"), described("s", "positive when the forces lag")
    ] = np.nan
    std: Annotated[OpenNumber, described("s", "standard deviation of the delay")] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the two-sided test of no delay")
    ] = np.nan
    level: Annotated[float, Field(exclude=True), described("1", "of the test")] = DELAY

    @property
    def failed(self) -> bool:
        """Tell whether there is a delay."""
        return bool(np.isfinite(self.log_p) and self.log_p < np.log(self.level))

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return (
            {"refused": self.refused} if self.refused else {**fields(self), "failed": self.failed}
        )


def delay_test(solved: SolvedSystem, part: Linearisation, level: float = DELAY) -> DelayTest:
    """Estimate the delay; dry friction, whose jumps have no derivative, takes no part."""
    if part.delay_column is None:
        reason = "pointwise kinematics give no derivative of the forces in time"
        return DelayTest(reason, level=level)
    score, information, _ = solved.scores(part.delay_column[:, :, None])
    if information[0] <= 0:
        return DelayTest("the forces do not change in time", level=level)
    std = 1 / np.sqrt(information[0])
    log_p = log_two_sided(np.array(score[0] * std), solved.system.freedom)
    return DelayTest("", float(score[0] * std**2), float(std), float(log_p), level)
