"""A strut on a thread: its halves turn against each other, and the screw with them.

The lower half turns with the cardan joint at the base, the upper one with a cardan joint at the
platform. The second axis of a cardan joint is across its first one and the strut: e × u. δ is the
angle about u from that of the base's joint to that of the platform's. On a thread of lead h the
actuator has turned by (l − q) 2π/h less than the distance l of the joints tells: l = q + h δ/2π
where a positive h is a right-handed thread.

Source: StrutLengthCorrection of LinuxCNC's genhexkins for non-captive screws between cardan joints.
There the directions of the axes have a sense: with those of base and platform against each other,
as they are built in, a lead above zero is right-handed; with both alike it is left-handed.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.strut import StrutKinematics


class ThreadTurn:
    """δ of one strut and what it depends on; vectors (3, 1) in the base frame.

    Parameters
    ----------
    strut : StrutKinematics
    arm : (3, 1)
        From the TCP to the platform joint B, m.
    base_axis, platform_axis : (3, 1)
        First axes of the two cardan joints, unit vectors, fixed in base and platform.
    """

    def __init__(
        self, strut: StrutKinematics, arm: ca.SX, base_axis: ca.SX, platform_axis: ca.SX
    ) -> None:
        u = strut.direction
        lower, upper = ca.cross(base_axis, u), ca.cross(platform_axis, u)
        # rad
        self.angle = ca.atan2(ca.dot(upper, ca.cross(u, lower)), ca.dot(upper, lower))
        # A half that is held by an axis n spins about u by (n·u) n₂·u̇/s, with n₂ = n × u/s of unit
        # length, and by (ω·u − (n·u) ω·n)/s² where n turns with ω; u̇ = (1 − u uᵀ) v_B/l.
        transverse = _spin(upper, platform_axis, u) - _spin(lower, base_axis, u)
        turned = u - ca.dot(platform_axis, u) * platform_axis
        force = transverse / strut.length
        # (6, 1): δ̇ = wrenchᵀ V, and of a torque of one about u between the halves the wrench on
        # the platform
        self.wrench = ca.vertcat(force, ca.cross(arm, force) + turned / ca.dot(upper, upper))


def _spin(second: ca.SX, first: ca.SX, u: ca.SX) -> ca.SX:
    """Return w of the spin w·u̇ about u, of a half whose first axis does not turn."""
    return ca.dot(first, u) * second / ca.dot(second, second)
