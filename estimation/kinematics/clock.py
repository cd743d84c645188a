"""Whether the recording repeats as fast as it is said to.

With a frequency that is off by the share ε the periods move against each other: at time t the
lengths are l(t) + ε t l̇(t). The part of it that grows from period to period is what a fitted motion
leaves of the lengths; its slope tells ε.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model import HarmonicMotion
from estimation.processing import Record
from expdesign.robot import Robot

_ON_TIME = 1e-9
"""Share of a period by which rounding may put a sample into the period before."""


def clock_error(
    robot: Robot, record: Record, motion: HarmonicMotion, covariance: Array
) -> tuple[float, float]:
    """Return how much faster the recording runs than `motion`, relative, and its std.

    Parameters
    ----------
    motion : HarmonicMotion
        Fitted with the frequency in question.
    covariance : (6, 6)
        Δ of one sample, m².

    Notes
    -----
    To first order: right while the periods move by a small part of a period. Less than two periods
    tell little: the std is then inf.
    """
    pose, rate = (
        basis @ motion.table.T for basis in motion.basis(record.length_times).derivatives[:2]
    )
    lengths, jacobian = robot.lengths_and_jacobian(pose)
    speeds = np.einsum("sij,sj->si", jacobian, rate)
    weighted = speeds @ np.linalg.inv(covariance)
    if record.length_periods is not None:
        count = len(record.length_periods)
        late = (np.arange(count) - (count - 1) / 2) * record.period
        moved = np.tensordot(late, record.length_periods, axes=1)
        known = float(np.sum(late**2) * np.sum(speeds * weighted))
        right = float(np.sum(moved * weighted))
    else:
        # Whole periods: what of ε t l̇ repeats with them is in the fitted motion already.
        elapsed = record.length_times - np.min(record.length_times)
        late = np.floor(elapsed / record.period + _ON_TIME) * record.period
        late -= np.average(late, weights=record.length_counts)
        counted = late * record.length_counts
        known = float(np.sum((counted * late)[:, None] * speeds * weighted))
        right = float(np.sum(counted[:, None] * (record.lengths - lengths) * weighted))
    if record.periods < 2 or known <= 0:  # noqa: PLR2004 - a slope takes two
        return 0.0, np.inf
    return right / known, float(1 / np.sqrt(known))
