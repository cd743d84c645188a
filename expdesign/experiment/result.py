"""The result of a design: the trajectory, its check, and how the search went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.experiment.combinations import KnownCombination
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.recheck.limit_check import Recheck
from expdesign.robot import Robot
from expdesign.solver.finish import HumDistance
from expdesign.solver.jobs import status_text
from expdesign.solver.search import SearchResult
from expdesign.trajectory import FourierTrajectory

_LARGE = 100.0
_WHOLE = 1e-6


def whole(value: float) -> int | None:
    """Return a value as a whole number where it is one but for rounding, else None."""
    return round(value) if abs(value - round(value)) < _WHOLE else None


@dataclass(frozen=True)
class PredictedPrecision:
    """Standard deviations of the Gauss–Markov estimates, √diag F⁻¹, by parameter, SI.

    Information is counted over so many samples.
    """

    samples: int
    periods: float
    std: dict[str, float]


def imprecise(robot: Robot, precision: PredictedPrecision) -> tuple[str, ...]:
    """Return a warning that names what the whole experiment does not identify, or nothing."""
    scales = dict(zip(robot.parameter_names, robot.scales, strict=True))
    share = {name: std / float(scales[name]) for name, std in precision.std.items()}
    weak = [f"{n} ({_percent(value)})" for n, value in share.items() if not value <= IDENTIFIABLE]
    if not weak:
        return ()
    return (
        f"not identifiable with this experiment: {', '.join(weak)}. In brackets the predicted "
        f"standard deviation, which is to be below {100 * IDENTIFIABLE:g} % of the value: measure "
        "more periods, or state what is known (`estimate.fixed`, `estimate.prior`)",
    )


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "without bound"
    return f"{100 * share:.2g} %" if share > _LARGE else f"{100 * share:.0f} %"


@dataclass(frozen=True)
class DesignResult:
    """A designed trajectory with everything that is reported about it.

    It is judged by the `parameter_names` and over the `samples` of one period.
    """

    configuration: RunConfiguration
    robot: Robot
    trajectory: FourierTrajectory
    samples: int
    samples_per_period: float
    """Controller steps; whole unless the frequency was fixed otherwise."""
    parameter_names: tuple[str, ...]
    information: Array
    """(k, k) F of one period by the unsmoothed model with the full Σ, SI."""
    log_det_information: float
    criterion_value: float
    per_period: PredictedPrecision
    experiment: PredictedPrecision
    systematic: dict[str, float]
    """Standard deviation that the robot's tolerances make of each parameter, SI, however many
    periods are measured; empty without tolerances."""
    check: Recheck
    search: SearchResult
    seconds: float
    warnings: tuple[str, ...]
    base_parameters: tuple[KnownCombination, ...] = ()
    """The combinations that the whole experiment identifies."""
    hum: tuple[HumDistance, ...] = ()
    """Hums of the noise, and how far the motion's frequency keeps away from each."""

    @property
    def status(self) -> str:
        """``"limits broken"``, ``"interrupted"``, ``"converged"`` or ``"not converged"``."""
        if not self.check.passed:
            return "limits broken"
        if self.search.interrupted:
            return "interrupted"
        record = self.search.finished.record
        finished = record is None or record.converged
        return "converged" if self.search.best.converged and finished else "not converged"

    @property
    def status_text(self) -> str:
        """How the best start and its finish ended, in words."""
        record = self.search.finished.record
        finish = "not solved again" if record is None else status_text(record.status)
        return f"start: {self.search.best.status}; finish: {finish}"

    @property
    def passed(self) -> bool:
        """True when every limit is kept and the search came to its end."""
        return self.status in {"converged", "not converged"}
