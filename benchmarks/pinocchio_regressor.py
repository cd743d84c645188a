"""What a sample takes in Pinocchio's regressor of PaLiDA: a process of its own, JSON in and out.

Run by a Python that has Pinocchio (`pip install pin`); nothing of this project is imported. The
tree is the platform on a free flyer and, from the base, six times ring (about x), stator (about y)
and slider (along z): 24 degrees of freedom, 19 bodies. The struts end in the platform's joints B,
where the loops are cut. With N, what all coordinates do when the actuators move, (24, 6), forces
of the tree τ = Y π make Q = Nᵀ τ at the actuators.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin  # type: ignore[import-not-found]

_LONG_ENOUGH = 0.5
"""Seconds for each figure."""
_AT_ONCE = 100
"""States between two looks at the clock: some milliseconds."""
_PLATFORM = 6
_STRUTS = 6
_TURNS = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)


class Tree:
    """The machine as Pinocchio has it.

    Parameters
    ----------
    machine : mapping
        Of the geometry, lists in SI: `gravity` (3), `platform_joints` (6, 3), `frames` of the
        struts at rest, (6, 3, 4): axes in columns, and the cardan's centre. `bodies`: mass, centre
        and inertia's diagonal about the centre of `platform`, `ring`, `stator` and `slider`.
    """

    def __init__(self, machine: dict[str, Any]) -> None:
        bodies = {name: _inertia(*about) for name, about in machine["bodies"].items()}
        self.model = pin.Model()
        self.model.gravity = pin.Motion(np.array(machine["gravity"]), np.zeros(3))
        here = pin.SE3.Identity()
        platform = self.model.addJoint(0, pin.JointModelFreeFlyer(), here, "platform")
        self.model.appendBodyToJoint(platform, bodies["platform"], here)
        self.platform, self.ends = platform, []
        for j, frame in enumerate(np.array(machine["frames"])):
            above, place = 0, pin.SE3(frame[:, :3], frame[:, 3])
            joints = (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelPZ())
            for name, joint in zip(("ring", "stator", "slider"), joints, strict=True):
                above = self.model.addJoint(above, joint, place, f"{name}{j}")
                self.model.appendBodyToJoint(above, bodies[name], here)
                place = here
            self.ends.append(above)
        self.joints = np.array(machine["platform_joints"])
        arms = [pin.skew(joint) for joint in self.joints]
        self.moved = np.array([np.concatenate([np.eye(3), -arm], axis=1) for arm in arms])
        self.data = self.model.createData()
        self.parameters = np.concatenate(
            [each.toDynamicParameters() for each in list(self.model.inertias)[1:]]
        )

    def configured(self, pose: Any, rate: Any, acceleration: Any, struts: Any) -> tuple[Any, ...]:
        """Return q, q̇ and q̈ with closed loops.

        Of the pose with its derivatives, (6,) each, and the struts' α, β and lengths, (6, 3).
        """
        chain = pin.Model()
        above = 0
        for joint in (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ, *_TURNS):
            above = chain.addJoint(above, joint(), pin.SE3.Identity(), f"{above}")
        moving = chain.createData()
        pin.forwardKinematics(chain, moving, pose, rate, acceleration)
        q = np.concatenate([pin.SE3ToXYZQUAT(moving.oMi[above]), np.ravel(struts)])
        still = np.zeros(3 * _STRUTS)
        v = np.concatenate([moving.v[above].vector, still])
        a = np.concatenate([moving.a[above].vector, still])
        v[_PLATFORM:] = self.follow(q) @ v[:_PLATFORM]
        # The struts' ends have to go where the joints B go as points of the platform.
        pin.forwardKinematics(self.model, self.data, q, v, a)
        rotation = self.data.oMi[self.platform].rotation
        velocity, change = self.data.v[self.platform], self.data.a[self.platform]
        turning = pin.skew(velocity.angular)
        swung = pin.skew(change.angular) + turning @ turning
        ahead = change.linear + turning @ velocity.linear + self.joints @ swung.T
        here = [
            pin.getClassicalAcceleration(self.model, self.data, end, pin.LOCAL_WORLD_ALIGNED).linear
            for end in self.ends
        ]
        apart = ahead @ rotation.T - np.array(here)
        a[_PLATFORM:] = np.linalg.solve(self._ends(), apart[:, :, None]).ravel()
        return q, v, a

    def follow(self, q: Any) -> Any:
        """Return what the struts' coordinates do for the platform's twist, (18, 6)."""
        pin.computeJointJacobians(self.model, self.data, q)
        rotation = self.data.oMi[self.platform].rotation
        moved = np.matmul(rotation, self.moved)
        return np.linalg.solve(self._ends(), moved).reshape(3 * _STRUTS, _PLATFORM)

    def _ends(self) -> Any:
        """Return what each strut's end does for its own coordinates, (6, 3, 3)."""
        own = self.data.J[:, _PLATFORM:].reshape(6, _STRUTS, 3).transpose(1, 0, 2)
        arms = np.array([pin.skew(self.data.oMi[end].translation) for end in self.ends])
        return own[:, :3] - np.matmul(arms, own[:, 3:])

    def regressor(self, q: Any, v: Any, a: Any) -> Any:
        """Return Y, (24, 190), of the tree's forces."""
        return pin.computeJointTorqueRegressor(self.model, self.data, q, v, a)

    def at_actuators(self, q: Any, v: Any, a: Any) -> Any:
        """Return Nᵀ Y, (6, 190), of the actuators' forces."""
        regressor = self.regressor(q, v, a)
        follow = self.follow(q)
        lengths = follow[2::3]
        both = regressor[:_PLATFORM] + follow.T @ regressor[_PLATFORM:]
        return np.linalg.solve(lengths.T, both)


def _inertia(mass: float, centre: Any, diagonal: Any) -> Any:
    return pin.Inertia(mass, np.array(centre), np.diag(diagonal))


def _fastest(function: Callable[..., object], states: list[tuple[Any, ...]]) -> float:
    """Return what a sample takes, µs of CPU time, where it is least: beside other work, too."""
    parts = [states[k : k + _AT_ONCE] for k in range(0, len(states), _AT_ONCE)]
    least, end = np.inf, time.process_time() + _LONG_ENOUGH
    while time.process_time() < end:
        for part in parts:
            began = time.process_time()
            for state in part:
                function(*state)
            least = min(least, (time.process_time() - began) / len(part))
    return least * 1e6


def main() -> None:
    """Read machine and states; write forces, and what a sample takes."""
    given = json.load(sys.stdin)
    tree = Tree(given["machine"])
    states = [tree.configured(*each) for each in zip(*map(np.array, given["states"]), strict=True)]
    forces = [(tree.at_actuators(*state) @ tree.parameters).tolist() for state in states]
    found = {
        "version": pin.__version__,
        "forces": forces,
        "tree": _fastest(tree.regressor, states),
        "actuators": _fastest(tree.at_actuators, states),
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
