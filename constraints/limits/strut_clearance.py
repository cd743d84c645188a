"""Smallest distance between the axes of every two struts."""

import itertools

import casadi as ca
import numpy as np

from constraints.definition import LimitDefinition, Quantities


def _clamp(value: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(value, 0), 1)


def _squared_distance(start: ca.SX, along: ca.SX, other_start: ca.SX, other: ca.SX) -> ca.SX:
    """Squared distance of the segments start + s·along and other_start + t·other, s, t in [0, 1].

    The clamped sequence s → t → s is exact (Ericson, Real-Time Collision Detection, 5.1.9). Its
    square is continuously differentiable wherever the nearest points are unique.
    """
    offset = start - other_start
    aa, bb, ab = ca.dot(along, along), ca.dot(other, other), ca.dot(along, other)
    a_offset, b_offset = ca.dot(along, offset), ca.dot(other, offset)
    # For parallel segments every s is as good as another: the guard only avoids 0/0.
    determinant = ca.fmax(aa * bb - ab * ab, 1e-12 * aa * bb)
    s = _clamp((ab * b_offset - a_offset * bb) / determinant)
    t = _clamp((ab * s + b_offset) / bb)
    s = _clamp((ab * t - a_offset) / aa)
    gap = offset + s * along - t * other
    return ca.dot(gap, gap)


def _squared_clearances(q: Quantities) -> ca.SX:
    base, tip = q["base_joints"], q["platform_joints"]
    return ca.vertcat(
        *(
            _squared_distance(
                base[:, i], tip[:, i] - base[:, i], base[:, j], tip[:, j] - base[:, j]
            )
            for i, j in itertools.combinations(range(base.shape[1]), 2)
        )
    )


LIMIT = LimitDefinition(
    key="strut_clearance",
    title="clearance between struts",
    unit="m",
    kind="lower",
    pairs=True,
    requires=("base_joints", "platform_joints"),
    natural=lambda q: ca.sqrt(_squared_clearances(q)),
    smooth=_squared_clearances,
    transform=np.square,
)
