"""The moving robot: positions of its joints, forces, and the limits that are reached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.experiment import DesignResult
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck.limit_check import REACHED, reached_limits
from expdesign.robot import LimitModel, Robot
from results.views.folder import RunFolder
from results.views.view import Animation

_FRAMES = 240
"""Most instants of one period in the view: finer than the eye at the speed of the machine."""
_LIMITED_FORCE = "actuator_force"


@dataclass(frozen=True, eq=False)
class _Motion:
    """A motion of one period: states (N, 18) and forces (N, 6) at times (N,), SI."""

    what: str
    model: str
    """Of the forces."""
    time: Array
    states: Array
    force: Array


def robot_animation(folder: RunFolder) -> Animation | None:
    """Return the moving robot of a folder's design, else of its estimate; None without either."""
    motion = _motion(folder)
    if motion is None:
        return None
    caption = (
        f"{motion.what} over one period, struts coloured by the actuator force {motion.model}; "
        "positive extends. In magenta: struts, and the platform, that use "
        f"{100 * REACHED:g} % of a limit or more at the moment shown; the bar below the slider "
        "tells when. Drag to rotate, scroll to zoom."
    )
    robot, time, pose = folder.configuration.robot, motion.time, motion.states[:, :COORDINATES]
    period = float(time[-1] - time[0]) * time.size / (time.size - 1)
    chosen = np.unique(np.linspace(0, time.size, _FRAMES, endpoint=False).astype(np.intp))
    joints = np.stack([robot.struts_at(place).joints for place in pose[chosen]])
    largest = float(np.max(np.abs(motion.force)))
    data = {
        "period": round(period, 9),
        "time": _rounded(time[chosen] - time[0], 5),
        "base": _rounded(1e3 * robot.base_joints, 2),
        "joints": _rounded(1e3 * joints, 2),
        "tool": _rounded(1e3 * pose[chosen, :3], 2),
        "force": _rounded(motion.force[chosen], 2),
        "largest": largest if largest > 0 else 1.0,
        **_limits(Robot(robot), motion, chosen),
    }
    return Animation("robot", caption, data)


def _motion(folder: RunFolder) -> _Motion | None:
    if folder.has("design"):
        one = folder.result(DesignResult).motion
        states = np.concatenate([one.pose, one.pose_rate, one.pose_acceleration], axis=1)
        what, model = "The designed trajectory", "at the nominal parameters"
        return _Motion(what, model, one.time, states, one.force)
    from estimation.identification.result import EstimationResult

    motions = folder.result(EstimationResult).motions if folder.has("estimate") else {}
    if 1 not in motions or len(motions[1].time) < 2:  # noqa: PLR2004 - it begins and ends
        return None
    executed = motions[1]
    what, model = "The executed motion as it was estimated,", "of the estimated model"
    return _Motion(what, model, executed.time, executed.state, executed.forces_model)


def _limits(robot: Robot, motion: _Motion, chosen: NDArray[np.intp]) -> dict[str, Any]:
    """Return the limits that are reached, and the reached ones of every frame.

    `limits` has title, row, struts (from zero), and whether the limit belongs to the platform;
    `reached` has positions in it, frame by frame, for the time until the next frame.
    """
    model = LimitModel.of(robot)
    values = model.values(motion.states)
    for limit, columns in zip(model.limits, model.columns, strict=True):
        if limit.key == _LIMITED_FORCE:
            # Those that are shown, which may be of an estimate.
            values[:, columns] = motion.force
    at = reached_limits(model, values)
    by_frame = np.logical_or.reduceat(at, chosen, axis=0)
    rows = np.flatnonzero(np.any(by_frame, axis=0))
    position = {row: k for k, row in enumerate(rows.tolist())}
    named = [(limit.definition.title, label) for limit in model.limits for label in limit.labels]
    return {
        "limits": [_named(*named[row]) for row in rows],
        "reached": [
            [position[row] for row in np.flatnonzero(frame).tolist()] for frame in by_frame
        ],
    }


def _named(title: str, row: str) -> dict[str, Any]:
    word, _, numbers = row.partition(" ")
    of_struts = word in ("strut", "struts")
    struts = [int(number) - 1 for number in numbers.split("-")] if of_struts else []
    return {"title": title, "row": row, "struts": struts, "platform": not of_struts}


def _rounded(values: Array, digits: int) -> Any:
    # Adding zero turns −0.0 into 0.0.
    return (np.round(values, digits) + 0.0).tolist()
