"""The delay between the channels of lengths and forces that fits best: one Gauss–Newton step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.levels import DELAY
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.tails import log_two_sided


@dataclass(frozen=True)
class DelayTest:
    """By how much the forces lag behind the lengths, beyond the delays that were given.

    Attributes
    ----------
    refused : str
    delay, std : float
        s; positive when the forces lag.
    log_p : float
        Of the two-sided test of no delay.
    level : float
    """

    refused: str
    delay: float
    std: float
    log_p: float
    level: float = DELAY

    @property
    def failed(self) -> bool:
        """Tell whether there is a delay."""
        return bool(np.isfinite(self.log_p) and self.log_p < np.log(self.level))


def delay_test(solved: SolvedSystem, part: Linearisation, level: float = DELAY) -> DelayTest:
    """Estimate the delay; dry friction, whose jumps have no derivative, takes no part."""
    if part.delay_column is None:
        reason = "pointwise kinematics give no derivative of the forces in time"
        return DelayTest(reason, np.nan, np.nan, np.nan, level)
    score, information, _ = solved.scores(part.delay_column[:, :, None])
    if information[0] <= 0:
        return DelayTest("the forces do not change in time", np.nan, np.nan, np.nan, level)
    std = 1 / np.sqrt(information[0])
    log_p = log_two_sided(np.array(score[0] * std), solved.system.freedom)
    return DelayTest("", float(score[0] * std**2), float(std), float(log_p), level)
