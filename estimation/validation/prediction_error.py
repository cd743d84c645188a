"""Size of the prediction error of each actuator, corrected for the noise.

With enough data, a test finds an error in every real model; its size is estimated here. With the
mean residual e of an actuator at R phases of the motion, its covariance V for a correct prediction
(noise of the forces, and of the motion fitted to the lengths) and the error b,

    E Σ e² = tr V + Σ b²,        Var Σ e² = 2 tr V² + 4 bᵀ V b,

so that (Σ e² − tr V) / R estimates the mean square of b without bias. The errors of the parameters
are part of b, since every use of the model contains them. The variance of tr V is added; its
degrees of freedom are those of the noise's covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
import scipy
from scipy.special import ndtri

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.significance import LACK_OF_FIT
from estimation.estimators import Experiment
from expdesign.configuration import ForceTolerance
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity
from expdesign.robot import Robot
from expdesign.runfolder import OpenNumber, described

_SIDES = float(ndtri(0.975))
"""Half width of a 95 % interval in standard deviations."""

_FOUND = 0.9
"""Probability of detection that defines a detectable error."""


class Kept(StrEnum):
    """Comparison of an error with its tolerance."""

    WITHIN = "within"
    BEYOND = "beyond"
    OPEN = "not decided"
    UNKNOWN = ""


@dataclass(frozen=True)
class Accuracy:
    """Error of the predicted force of one actuator on one motion."""

    actuator: Annotated[int, described("1", "actuator")]
    error: Annotated[float, described("N", "rms of the error, noise taken off")]
    error_low: Annotated[float, described("N", "lower end of its 95 % interval")]
    error_high: Annotated[float, described("N", "upper end of its 95 % interval")]
    largest_residual: Annotated[
        float, described("N", "largest of measured minus predicted force, mean over the periods")
    ]
    largest_error: Annotated[
        float, described("N", "its part beyond the noise, at 95 %; 0 if all may be noise")
    ]
    range: Annotated[float, described("N", "largest less smallest predicted force")]
    detectable: Annotated[
        OpenNumber,
        described(
            "N",
            "rms of an error that the lack-of-fit test finds in 90 % of cases; empty where the "
            "noise is not known",
        ),
    ]
    tolerance: Annotated[OpenNumber, described("N", "that is good enough; empty without one")]
    kept: Annotated[Kept, described("", "within, beyond or not decided; empty without tolerance")]


def prediction_errors(
    robot: Robot, experiment: Experiment, values: Array, tolerance: ForceTolerance | None
) -> tuple[Accuracy, ...]:
    """Return the errors of held-out forces predicted with parameters (m,)."""
    motion = None if experiment.fit is None else experiment.fit.motion
    part = linearise(robot, experiment, values, np.zeros(len(values), dtype=bool), motion)
    channels = experiment.recording.forces
    as_recorded, response = channels.as_recorded, channels.response
    part = replace(
        part,
        forces=as_recorded(part.forces),
        motion_columns=as_recorded(part.motion_columns),
        sign_errors=part.filter_signs(None if response is None else as_recorded),
    )
    spans = np.ptp(experiment.fitted_regressors @ values, axis=0)
    return tuple(
        _of_actuator(part, experiment, j, float(spans[j]), tolerance) for j in range(ACTUATORS)
    )


def _of_actuator(
    part: Linearisation,
    experiment: Experiment,
    channel: int,
    span: float,
    tolerance: ForceTolerance | None,
) -> Accuracy:
    residuals = part.forces[:, channel]
    spread = _Spread.of(part, experiment, channel)
    low, high = spread.bounds(residuals)
    rows = len(residuals)
    rms = np.sqrt(np.maximum([spread.excess(residuals), low, high], 0.0) / rows)
    # Simultaneous over all phases.
    reach = float(scipy.stats.norm.ppf(1 - 0.025 / rows)) * np.sqrt(spread.variances)
    kept, allowed = Kept.UNKNOWN, np.nan
    if tolerance is not None:
        allowed = tolerance.force(span)
        kept = Kept.OPEN
        if rms[2] <= allowed:
            kept = Kept.WITHIN
        elif rms[1] > allowed:
            kept = Kept.BEYOND
    return Accuracy(
        actuator=channel + 1,
        error=float(rms[0]),
        error_low=float(rms[1]),
        error_high=float(rms[2]),
        largest_residual=float(np.max(np.abs(residuals))),
        largest_error=float(np.max(np.maximum(np.abs(residuals) - reach, 0.0))),
        range=span,
        detectable=float(np.sqrt(spread.detectable() / rows)),
        tolerance=float(allowed),
        kept=kept,
    )


@dataclass(frozen=True, eq=False)
class _Spread:
    """V of one actuator's mean residuals: noise, and U C Uᵀ of the fitted motion."""

    diagonal: Array
    """(R,), variances due to noise and unknown signs of friction, N²."""
    size: Array
    """(R,), size of the noise at each row, relative to its root mean square."""
    lines: Array | None
    """(L,), variances of the lines of the noise over its size; None for white noise."""
    factor: Array
    """(R, x), U C^½."""
    contrasts: float
    """Complex degrees of freedom of every line; inf if given."""
    freedom: float
    """Degrees of freedom of the noise's variance; inf if given."""
    known: bool
    """False: the noise comes from the residuals of a model and cannot be subtracted."""

    @classmethod
    def of(cls, part: Linearisation, experiment: Experiment, channel: int) -> _Spread:
        noise, fit = experiment.noise.forces, experiment.fit
        variance, size = float(noise.variances[channel]), np.ones(len(part.counts))
        if noise.filter is not None and noise.filter.size is not None:
            size = noise.filter.size[:, channel]
        diagonal = variance * size**2 / part.counts + part.sign_variance[:, channel]
        factor = np.zeros((len(part.counts), 0))
        if fit is not None:
            factor = part.motion_columns[:, channel] @ np.linalg.cholesky(
                np.asarray(fit.covariance)
            )
        lines, contrasts, freedom = None, np.inf, noise.freedom
        if noise.lines is not None and noise.lines.samples == len(part.counts):
            recorded = experiment.recording.forces.recorded_lines(noise.lines).matrices
            lines = recorded[:, channel, channel].real * np.mean(1 / part.counts)
            contrasts = noise.lines.freedom
            # Degrees of freedom of the sum over all lines; its squares are too large.
            times = multiplicity(noise.lines.samples)
            spread = (times @ lines) ** 2 / (times @ lines**2) * (1 + 1 / contrasts)
            freedom = contrasts * float(spread) / float(np.mean(size**4))
        known = not noise.includes_model_error
        return cls(diagonal, size, lines, factor, contrasts, freedom, known)

    @property
    def variances(self) -> Array:
        """(R,), the diagonal of V."""
        return self.diagonal + np.sum(self.factor**2, axis=1)

    @property
    def trace(self) -> float:
        """Trace of V; zero if unknown."""
        return float(np.sum(self.variances)) if self.known else 0.0

    def excess(self, residuals: Array) -> float:
        """Return the estimate of Σ b², which may be negative."""
        return float(residuals @ residuals) - self.trace

    def quadratic(self, values: Array) -> float:
        """Return vᵀ V v."""
        own = values**2 @ self.diagonal
        if self.lines is not None:
            powers = np.abs(lines_of(values * self.size)) ** 2 * multiplicity(len(values))
            noise = np.sum(powers * self.lines)
            white = np.sum(powers) * self._mean_line
            own += noise - white
        return float(own + np.sum((self.factor.T @ values) ** 2))

    @property
    def _mean_line(self) -> float:
        if self.lines is None:
            return 0.0
        return float(multiplicity(len(self.diagonal)) @ self.lines / len(self.diagonal))

    @property
    def squares(self) -> float:
        """Tr V²."""
        mixed = self.factor.T @ (self.factor * self.diagonal[:, None])
        inner = self.factor.T @ self.factor
        total = np.sum(self.diagonal**2) + 2 * np.trace(mixed) + np.sum(inner**2)
        if self.lines is not None:
            times, count = multiplicity(len(self.diagonal)), len(self.diagonal)
            own = float(times @ self.lines**2) / (1 + 1 / self.contrasts)
            total += max(own - count * self._mean_line**2, 0.0) * float(np.mean(self.size**4))
        return float(total)

    @property
    def uncertainty(self) -> float:
        """Variance of the estimate of Σ b² without an error."""
        return 2 * self.squares + 2 * float(np.sum(self.diagonal)) ** 2 / self.freedom

    def bounds(self, residuals: Array) -> tuple[float, float]:
        """Return the ends of the 95 % interval of Σ b²."""
        found = self.excess(residuals)
        if not self.known:
            return 0.0, found
        share = self.squares / self.trace
        along = self.quadratic(residuals) - self.squares
        slope = max(share, along / found if found > 0 else 0.0)
        # (D − found)² = z² (uncertainty + 4 slope D)
        middle = found + 2 * _SIDES**2 * slope
        root = middle**2 - found**2 + _SIDES**2 * self.uncertainty
        half = np.sqrt(max(root, 0.0))
        return max(middle - half, 0.0), max(middle + half, 0.0)

    def detectable(self) -> float:
        """Return the Σ b² that the test of one actuator detects; NaN without a known noise."""
        if not self.known:
            return np.nan
        level = float(scipy.stats.norm.isf(LACK_OF_FIT / ACTUATORS)) * np.sqrt(self.uncertainty)
        z, slope = float(scipy.stats.norm.ppf(_FOUND)), self.squares / max(self.trace, 1e-300)
        middle = level + 2 * z**2 * slope
        return float(middle + np.sqrt(middle**2 - level**2 + z**2 * self.uncertainty))
