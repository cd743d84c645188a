"""Test of the forces' gains for a drift, such as a motor constant that falls as the motor warms up.

Differences between periods show it independently of errors of the model, which are the same in
every period. In each period the residuals of all actuators are regressed on the predicted force and
on a constant of each actuator, weighted with Σ⁻¹ (a filter of the noise applies to residuals and
columns alike); the gains are regressed on the number of the period. Their scatter about these
lines, over all actuators together, scales the variance according to Σ, so that coloured noise, or a
given Σ that is too small, does not appear as a drift. The constants have another scatter: a filter
knows less of the slowest noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from constraints.arrays import Array
from estimation.diagnostics.joint_system import ConditionalScores
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.noise_tests import why_not_compared
from estimation.diagnostics.significance import GAIN_DRIFT, OmissibleTest, Strut, log_tail
from estimation.estimators.experiment import Experiment
from estimation.measurement_model.motion import NormalEquations
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumber, described

_FEWEST_PERIODS = 4
"""Smallest number of periods that leaves a scatter about lines."""


@dataclass(frozen=True)
class GainDrift:
    """Drift of one force's gain, or of all gains alike."""

    actuator: Annotated[Strut, described("1", "number of the actuator; null: all alike")]
    change: Annotated[OpenNumber, described("1", "change from the first period to the last")]
    std: Annotated[OpenNumber, described("1", "standard deviation of the change")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p, corrected for their number")]


@dataclass(frozen=True, eq=False, kw_only=True)
class GainDriftTest(OmissibleTest):
    """Test of all gains for a drift."""

    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of all candidates together")
    ] = GAIN_DRIFT
    scale: Annotated[
        OpenNumber,
        described("1", "variance of the gains between periods, relative to Σ"),
    ] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the most significant, corrected")
    ] = np.nan
    found: Annotated[
        tuple[GainDrift, ...], described("", "drifting gains, most significant first")
    ] = ()


def gain_drift(experiment: Experiment, part: Linearisation, level: float) -> GainDriftTest:
    """Test the recording of one experiment, linearised at its estimate, for drifting gains."""
    if experiment.recording.averaged and experiment.recording.forces.periods is None:
        return GainDriftTest(refused=why_not_compared(experiment.recording), level=level)
    residuals, columns = _split_periods(experiment, part)
    periods = len(residuals)
    if periods < _FEWEST_PERIODS:
        refused = f"fewer than {_FEWEST_PERIODS} periods leave no scatter about lines"
        return GainDriftTest(refused=refused, level=level)
    noise = experiment.noise.forces.covariance
    fits = [
        NormalEquations.of([(rest, own, np.ones(len(rest)))], noise)
        for rest, own in zip(residuals, columns, strict=True)
    ]
    inverses = np.linalg.inv([fit.matrix for fit in fits])
    coefficients = np.einsum("mij,mj->mi", inverses, [fit.gradient for fit in fits])
    # Gains, with drifting constants fitted as well.
    gains = slice(ACTUATORS)
    values, covariance = coefficients[:, gains], inverses[:, gains, gains]
    time = np.arange(periods) - (periods - 1) / 2
    slope = time @ values / (time @ time)
    of_slope = np.einsum("m,mij->ij", time**2, covariance) / (time @ time) ** 2
    rest = values - np.mean(values, axis=0) - np.multiply.outer(time, slope)
    freedom = float(rest.shape[1] * (periods - 2))
    scale = float(np.einsum("mi,mij,mj->", rest, np.linalg.inv(covariance), rest)) / freedom
    test = GainDriftTest(level=level, scale=scale)
    return _select_drifts(slope, of_slope * scale, freedom, periods, test)


def _select_drifts(
    slope: Array, covariance: Array, freedom: float, periods: int, test: GainDriftTest
) -> GainDriftTest:
    """Select drifts one by one, of all gains alike or of single ones."""
    design = np.concatenate([np.ones((ACTUATORS, 1)), np.eye(ACTUATORS)], axis=1)
    inverse = np.linalg.inv(covariance)
    information = design.T @ inverse @ design
    scores = ConditionalScores(
        design.T @ inverse @ slope, information, np.diag(information), freedom
    )
    level, count = np.log(test.level), np.log(len(scores.score))
    chosen: list[int] = []
    log_ps: list[float] = []
    while len(chosen) < ACTUATORS:
        given = scores.conditional_on(chosen)
        diagonal = np.where(given.identifiable, np.diag(given.information), np.inf)
        log_p = log_tail(given.score**2 / diagonal, np.array(1), freedom)
        best = int(np.argmin(log_p))
        log_ps.append(min(0.0, float(log_p[best] + count)))
        if log_p[best] + count >= level:
            break
        chosen.append(best)
    fit, length = scores.fit(chosen), periods - 1
    found = tuple(
        GainDrift(
            actuator=place - 1 if place else None,
            change=float(fit.values[k]) * length,
            std=float(np.sqrt(fit.covariance[k, k])) * length,
            log_p=log_ps[k],
        )
        for k, place in enumerate(chosen)
    )
    return replace(test, log_p=log_ps[0], found=found)


def _split_periods(experiment: Experiment, part: Linearisation) -> tuple[list[Array], list[Array]]:
    """Return residuals, (n, 6), and columns, (n, 6, 12), of every whole period.

    The columns are those of gains and constants. With a filter of the noise both are filtered.
    """
    # `force_rows` are behind the filters of the sensors, the forces before them.
    filtered = experiment.recording.forces.response is not None
    predicted = experiment.forces - (part.forces if filtered else part.force_rows)
    unit = np.broadcast_to(np.eye(ACTUATORS), (len(predicted), ACTUATORS, ACTUATORS))
    columns = np.concatenate([predicted[:, :, None] * unit, unit], axis=2)
    whitening_filter = experiment.noise.forces.filter
    periods = experiment.recording.forces.periods
    if periods is not None:
        if experiment.pointwise is not None:
            periods = periods[:, experiment.pointwise.rows]
        residuals = list(periods - predicted)
        if experiment.pointwise is None and whitening_filter is not None:
            residuals = [whitening_filter(each) for each in residuals]
            columns = whitening_filter(columns)
        return residuals, [columns] * len(residuals)
    recording = experiment.recording
    times = experiment.times - experiment.times[0]
    number = np.floor(times / recording.period * (1 + 1e-12)).astype(int)
    rows = [np.flatnonzero(number == k) for k in range(int(recording.periods))]
    return [part.force_rows[each] for each in rows], [columns[each] for each in rows]
