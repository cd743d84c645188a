"""Proof of the limits of a machine whose controller follows the strut lengths of another robot.

The controller computes the lengths of a motion with its own joints. The struts move as commanded:
limits on their speed, acceleration and jerk are those of the commanded motion. The platform takes
the path that these lengths give with the joints of the machine, which is enclosed as that of a
table of struts is (`expdesign.enclosure.forward`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from constraints import Limit
from constraints.arrays import Array
from expdesign.enclosure.forward import EnclosedKinematics, StrutPath
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.recheck.certificate import CELLS, EnclosedMotion, certify, divided_cells
from expdesign.recheck.followed_lengths import FollowedLengths
from expdesign.recheck.limit_check import LEAST_POINTS, LimitCheck, states_at, worst_sampled
from expdesign.robot import LimitModel, Robot
from expdesign.robot.limit_model import JERK

_COMMANDED = frozenset({"strut_speed", "strut_acceleration", JERK})


def certify_followed(
    limits: LimitModel, followed: FollowedLengths, enclosed: EnclosedMotion
) -> tuple[LimitCheck, ...]:
    """Return the worst moment of every limit, with the proved bound of its excess.

    Parameters
    ----------
    limits : LimitModel
        Limits of the machine.
    followed : FollowedLengths
        The motion, the robot of the controller, and the machine.
    enclosed : EnclosedMotion
        The commanded motion, over cells of time.

    Raises
    ------
    ForwardKinematicsError
        No pose of the machine has the lengths.
    """
    commanded = tuple(limit for limit in limits.limits if _COMMANDED.issuperset(_read_by(limit)))
    others = tuple(limit for limit in limits.limits if limit not in commanded)
    found = certify(LimitModel(followed.robot, commanded), enclosed) if commanded else ()
    if others:
        found += _along_path(replace(limits, limits=others), followed, enclosed)
    checks = {check.key: check for check in found}
    return tuple(checks[limit.key] for limit in limits.limits)


def _read_by(limit: Limit) -> tuple[str, ...]:
    return limit.definition.requires


def _along_path(
    limits: LimitModel, followed: FollowedLengths, enclosed: EnclosedMotion
) -> tuple[LimitCheck, ...]:
    edges = divided_cells(enclosed.breaks, CELLS)
    times = np.append(edges[:, 0], edges[-1, 1])
    commanded = _CommandedLengths(followed.robot, enclosed, times, followed.zeros)
    path = StrutPath(
        followed.machine,
        commanded,
        lambda at: followed.motion.sample(at).pose,
        home=followed.motion.sample(times[:1]).pose[0],
    )
    if not np.isfinite(path.known_until):
        return certify(limits, path)
    at = np.linspace(times[0], times[-1], LEAST_POINTS)
    sampled = worst_sampled(limits, at, limits.values(states_at(followed, at)))
    return tuple(replace(check, proved=np.inf) for check in sampled)


@dataclass(frozen=True, eq=False)
class _CommandedLengths:
    """Lengths of the struts for a motion of the controller's robot, less errors of their zeros."""

    robot: Robot
    motion: EnclosedMotion
    times: Array
    """(N + 1,), s, ends of the first cells."""
    zeros: Array
    """(6,), m."""

    def over(self, edges: Array) -> list[TaylorModel]:
        """Return the models of the lengths over cells, (N', 2), s."""
        lengths = self._kinematics.lengths(self.motion.models(edges)[:6])
        return [
            model - TaylorModel.number(zero)
            for model, zero in zip(lengths, self.zeros, strict=True)
        ]

    def with_rates(self, edges: Array) -> list[list[TaylorModel]]:
        """Return the models of lengths, speeds and accelerations over cells, (N', 2), s."""
        models = self.motion.models(edges)
        rates = self._kinematics.strut_rates(*(models[k : k + 6] for k in (0, 6, 12)))
        return [self.over(edges), *rates]

    @cached_property
    def _kinematics(self) -> EnclosedKinematics:
        return EnclosedKinematics(self.robot)
