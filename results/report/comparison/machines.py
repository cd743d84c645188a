"""Which designs are for the same machine: only their information has a ratio that says something.

F of a motion is decided by joints, first cardan axes, gravity, the model and the noise of the
forces. Between machines that differ in one of them, det F differs by the machine and not by the
design. Values of the parameters do not enter F, limits decide which motions are allowed, and home
and names only describe: designs that differ in them are of the same machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot

COUNTED = "joints, first cardan axes, gravity and noise of the forces"
"""What makes a machine, in words, where the parameters are the same."""

_SAME = 1e-9
"""Difference, relative to the largest number of the kind, up to which machines are the same."""


def differing(one: ResolvedRobot, other: ResolvedRobot) -> tuple[str, ...]:
    """Return what makes two robots different machines, in words; empty for the same machine."""
    pairs: tuple[tuple[str, Array | None, Array | None], ...] = (
        ("joints of the base", one.base_joints, other.base_joints),
        ("joints of the platform", one.platform_joints, other.platform_joints),
        ("first cardan axes", one.alpha_axes, other.alpha_axes),
        ("gravity", one.gravity, other.gravity),
        ("noise of the forces", _force_covariance(one), _force_covariance(other)),
    )
    found = [words for words, first, second in pairs if not _same(first, second)]
    if one.terms != other.terms:
        found.append("terms of the model")
    return tuple(found)


def machines(robots: Sequence[ResolvedRobot]) -> tuple[int, ...]:
    """Return the machine of every robot: the position of the first that is the same."""
    found: list[int] = []
    for position, robot in enumerate(robots):
        earlier = (k for k in sorted(set(found)) if not differing(robots[k], robot))
        found.append(next(earlier, position))
    return tuple(found)


def _force_covariance(robot: ResolvedRobot) -> Array | None:
    return None if robot.noise is None else robot.noise.force_covariance


def _same(first: Array | None, second: Array | None) -> bool:
    if first is None or second is None:
        return first is second
    largest = float(np.max(np.abs(first)))
    return bool(np.allclose(first, second, rtol=0, atol=_SAME * largest))
