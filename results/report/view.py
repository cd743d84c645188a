"""The robot in motion: where its joints are over one period, and the forces of its struts."""

from __future__ import annotations

from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.identification.record import EstimateRecord
from expdesign.experiment import DesignRecord
from expdesign.mechanism.hexapod import COORDINATES
from results.report.content import ViewBlock
from results.report.folder import RunFolder

_FRAMES = 240
"""Most instants of one period in the view: finer than the eye at the speed of the machine."""


def robot_view(folder: RunFolder) -> ViewBlock | None:
    """Return the motion of a folder: of its design, else of its estimate; None without either."""
    if folder.has("design"):
        motion = folder.record(DesignRecord).motion
        time, pose, force = motion.time, motion.pose, motion.force
        what, model = "The designed trajectory", "at the nominal parameters"
    else:
        motions = folder.record(EstimateRecord).motions if folder.has("estimate") else {}
        if 1 not in motions or len(motions[1].time) < 2:  # noqa: PLR2004 - it begins and ends
            return None
        executed = motions[1]
        time, force = executed.time, executed.forces_model
        pose = executed.state[:, :COORDINATES]
        what, model = "The executed motion as it was estimated,", "of the estimated model"
    caption = (
        f"{what} over one period, struts coloured by the actuator force {model}; positive extends. "
        "Drag to rotate, scroll to zoom."
    )
    robot = folder.configuration.robot
    period = float(time[-1] - time[0]) * time.size / (time.size - 1)
    chosen = np.unique(np.linspace(0, time.size, _FRAMES, endpoint=False).astype(int))
    joints = np.stack([robot.struts_at(place).joints for place in pose[chosen]])
    largest = float(np.max(np.abs(force)))
    data = {
        "period": round(period, 9),
        "time": _rounded(time[chosen] - time[0], 5),
        "base": _rounded(1e3 * robot.base_joints, 2),
        "joints": _rounded(1e3 * joints, 2),
        "tool": _rounded(1e3 * pose[chosen, :3], 2),
        "force": _rounded(force[chosen], 2),
        "largest": largest if largest > 0 else 1.0,
    }
    return ViewBlock("robot", caption, data)


def _rounded(values: Array, digits: int) -> Any:
    # Adding zero turns −0.0 into 0.0.
    return (np.round(values, digits) + 0.0).tolist()
