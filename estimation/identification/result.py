"""What an estimation found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from constraints.arrays import Array
from estimation.estimators import Experiment, ParameterEstimate, ParameterPriors
from estimation.estimators.payload import PayloadEstimate, payload_estimate
from estimation.identification.term_selection import Selection
from estimation.uncertainty.consistency import ConsistentEstimate
from estimation.uncertainty.intervals import Combination, ParameterRow
from expdesign.configuration import RunConfiguration
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """One recording of the estimate."""

    source: str
    experiment: Experiment
    least_harmonics: int | None
    """The fewest that were tried; None when their number was given."""
    jitter: float
    """Of the time stamps, as a share of a step."""
    warnings: tuple[str, ...] = ()

    @property
    def harmonics(self) -> int | None:
        """Of the fitted motion; None after pointwise differentiation."""
        fit = self.experiment.fit
        return None if fit is None else fit.motion.harmonics

    @property
    def harmonics_of_forces(self) -> int | None:
        """Of the motion that ML estimates: what forces and lengths show together."""
        return self.experiment.harmonics


@dataclass(frozen=True, eq=False)
class EstimationResult:
    """Parameters with honest error bars."""

    configuration: RunConfiguration
    """The run, its robot with the terms that were added."""
    robot: Robot
    knowledge: ParameterPriors
    records: tuple[PreparedRecording, ...]
    estimates: dict[str, ParameterEstimate]
    rows: tuple[ParameterRow, ...]
    combinations: dict[str, tuple[Combination, ...]]
    """What is known of parameters that are not identified."""
    consistent: dict[str, ConsistentEstimate | None]
    """The nearest parameters that bodies have, by estimator; None: what is fixed leaves none."""
    bound: Array | None
    """(m, m) Cramér–Rao bound as a covariance, at the best estimate."""
    seconds: float
    warnings: tuple[str, ...]
    selection: Selection | None = None
    """Which terms were added to those of the robot file; None: none was tried."""

    @property
    def best(self) -> ParameterEstimate:
        """The estimate to use: ML if there is one, else GM, else LS."""
        return best_of(self.estimates)

    @cached_property
    def payloads(self) -> dict[str, PayloadEstimate]:
        """The payload by every estimator; empty where the prior is not of a machine without it."""
        before = self.knowledge.prior_estimate
        if before is None or before.unloaded is None:
            return {}
        return {name: payload_estimate(found, before) for name, found in self.estimates.items()}

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """The recordings as the estimators saw them."""
        return tuple(record.experiment for record in self.records)

    @property
    def intervals_cover(self) -> bool:
        """False after pointwise differentiation: the lengths' noise is not in the intervals."""
        return all(record.experiment.fit is not None for record in self.records)

    def __getitem__(self, estimator: str) -> ParameterEstimate:
        """Return one estimator's result."""
        return self.estimates[estimator]


def best_of(estimates: Mapping[str, ParameterEstimate]) -> ParameterEstimate:
    """Return the estimate to use of those by estimator: ML if there is one, else GM, else LS."""
    return next(estimates[name] for name in ("ml", "gm", "ls") if name in estimates)
