"""The result of a design: the trajectory, its check, and how the search went."""

from __future__ import annotations

from dataclasses import dataclass

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.recheck import Recheck
from expdesign.robot import Robot
from expdesign.solver.search import SearchResult
from expdesign.solver.start import status_text
from expdesign.trajectory import FourierTrajectory

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


@dataclass(frozen=True)
class DesignResult:
    """A designed trajectory with everything that is reported about it.

    Attributes
    ----------
    configuration : RunConfiguration
    robot : Robot
    trajectory : FourierTrajectory
        The one that was checked.
    samples : int
        Samples of one period over which the information is counted.
    samples_per_period : float
        Controller steps per period; whole unless the frequency was fixed otherwise.
    parameter_names : tuple of str
        Parameters that were judged.
    information : (k, k)
        F of one period by the unsmoothed model with the full Σ, SI.
    log_det_information, criterion_value : float
    per_period, experiment : PredictedPrecision
    check : Recheck
    search : SearchResult
    seconds : float
    warnings : tuple of str
    """

    configuration: RunConfiguration
    robot: Robot
    trajectory: FourierTrajectory
    samples: int
    samples_per_period: float
    parameter_names: tuple[str, ...]
    information: Array
    log_det_information: float
    criterion_value: float
    per_period: PredictedPrecision
    experiment: PredictedPrecision
    check: Recheck
    search: SearchResult
    seconds: float
    warnings: tuple[str, ...]

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
