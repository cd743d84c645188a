"""The forces that a given motion needs: by MuJoCo's kinematics and inverse dynamics, exactly.

The struts follow the platform by closing the loops with MuJoCo's Jacobians. Its recursive
Newton–Euler algorithm tells the generalised forces of the open tree; they are shared out between
the actuators and the forces that close the loops. Nothing is integrated and no constraint is soft,
so that rounding is the only error.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from tests.multibody.machine import STRUTS, mjcf

PLATFORM = slice(0, 6)
"""Degrees of freedom of the platform."""

SLIDERS = 6 + 2 + 3 * np.arange(STRUTS)
"""Degrees of freedom that are the struts' lengths."""

_OWN = slice(6, None)
_CLOSED = 1e-13
"""Gap at which a loop counts as closed [m]."""

_ITERATIONS = 50


@dataclass(frozen=True)
class Simulated:
    """What the machine does at N instants, with the forces of the actuators (N, 6) [N]."""

    joints: np.ndarray
    """(N, 24), the platform's six and α, β [rad] and length [m] of each strut."""
    rates: np.ndarray
    forces: np.ndarray

    @property
    def lengths(self):
        """Lengths of the struts, (N, 6) [m]."""
        return self.joints[:, SLIDERS]

    @property
    def length_rates(self):
        """Their rates, (N, 6) [m/s]."""
        return self.rates[:, SLIDERS]


class ExactMachine:
    """The machine with its loops closed to rounding.

    Parameters
    ----------
    geometry, bodies
        What it is made of.
    """

    def __init__(self, geometry, bodies):
        self.model = mujoco.MjModel.from_xml_string(mjcf(geometry, bodies))
        # The loops are closed and dry friction is added here: nothing is left to a solver.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self._ends = [
            (self.model.site(f"strut{j}").id, self.model.site(f"platform{j}").id)
            for j in range(STRUTS)
        ]
        self._start = np.zeros((STRUTS, 3))
        self._start[:, 2] = np.linalg.norm(
            geometry.home[:3] + geometry.platform_joints - geometry.base_joints, axis=1
        )

    def simulate(self, pose, rate, acceleration, dry_friction=1.0):
        """Return what the struts do along a motion.

        Parameters
        ----------
        pose, rate, acceleration
            (N, 6): x, y, z and the angles about the moving axes x, y, z, [m, rad], per s, per s²;
            each pose is near the one before it.
        dry_friction
            Share of all dry friction that counts in the forces.
        """
        count = len(pose)
        joints, rates = np.empty((count, self.model.nq)), np.empty((count, self.model.nv))
        forces = np.empty((count, STRUTS))
        self.data.qpos[_OWN] = self._start.ravel()
        for k in range(count):
            jacobian = self._move(pose[k], rate[k], acceleration[k])
            forces[k] = self._forces(jacobian, dry_friction)
            joints[k], rates[k] = self.data.qpos, self.data.qvel
        return Simulated(joints, rates, forces)

    def _move(self, pose, rate, acceleration):
        """Bring the machine into a state; return the Jacobian of the gaps, (18, 24)."""
        data = self.data
        jacobian = self._close(pose)
        own, platform = jacobian[:, _OWN], jacobian[:, PLATFORM]
        data.qvel[PLATFORM] = rate
        data.qvel[_OWN] = -np.linalg.solve(own, platform @ rate)
        mujoco.mj_fwdVelocity(self.model, data)
        changing = self._differences(
            lambda site, out: mujoco.mj_jacDot(
                self.model, data, out, None, data.site_xpos[site], self.model.site_bodyid[site]
            )
        )
        drift = changing @ data.qvel
        data.qacc[PLATFORM] = acceleration
        data.qacc[_OWN] = -np.linalg.solve(own, platform @ acceleration + drift)
        return jacobian

    def _forces(self, jacobian, dry_friction):
        needed = np.empty(self.model.nv)
        mujoco.mj_rne(self.model, self.data, 1, needed)
        needed -= self.data.qfrc_passive
        needed += dry_friction * self.model.dof_frictionloss * np.sign(self.data.qvel)
        # needed = actuators + Jᵀ λ. No actuator drives the platform or a cardan axis.
        passive = np.delete(np.arange(self.model.nv), SLIDERS)
        closing = np.linalg.solve(jacobian[:, passive].T, needed[passive])
        return (needed - jacobian.T @ closing)[SLIDERS]

    def _close(self, pose):
        """Put the struts to the platform by Newton's method; return the Jacobian of the gaps."""
        data = self.data
        data.qpos[PLATFORM] = pose
        for _ in range(_ITERATIONS):
            mujoco.mj_fwdPosition(self.model, data)
            gaps = np.concatenate([data.site_xpos[a] - data.site_xpos[b] for a, b in self._ends])
            jacobian = self._differences(
                lambda site, out: mujoco.mj_jacSite(self.model, data, out, None, site)
            )
            if np.abs(gaps).max() < _CLOSED:
                return jacobian
            data.qpos[_OWN] -= np.linalg.solve(jacobian[:, _OWN], gaps)
        raise RuntimeError(f"the loops stay open by {np.abs(gaps).max():g} m")

    def _differences(self, fill):
        """Return rows of strut's end minus platform's joint, (18, 24); `fill` writes one point."""
        strut, platform = (np.zeros((3, self.model.nv)) for _ in range(2))
        rows = np.empty((3 * STRUTS, self.model.nv))
        for j, (a, b) in enumerate(self._ends):
            fill(a, strut)
            fill(b, platform)
            rows[3 * j : 3 * j + 3] = strut - platform
        return rows
