"""ROS 2: JointTrajectory of the struts or MultiDOFJointTrajectory of the platform."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from expdesign.export import ros_bag, ros_yaml
from expdesign.export.definition import POSE_AXES, Settings, TableFormat, rounded_times
from expdesign.export.execution import Interpolation
from expdesign.export.ros_messages import message_of, rows_of
from expdesign.export.rows import Rows
from expdesign.mechanism.hexapod import numbered

_TIME_DIGITS = 9


def _encoding(settings: Settings) -> ModuleType:
    return ros_bag if settings.section.encoding == "mcap" else ros_yaml


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    _encoding(settings).write(path, message_of(rows, settings), settings)


def _read(path: Path, settings: Settings) -> Rows:
    return rows_of(_encoding(settings).read(path, settings), settings)


FORMAT = TableFormat(
    name="ros2",
    title="ROS 2, trajectory_msgs",
    suffix=".yaml",
    interpolation=Interpolation.QUINTIC,
    write=_write,
    read=_read,
    guide=(
        "Move the robot to the start below. Publish the YAML file once to your trajectory "
        'controller, `ros2 topic pub --once TOPIC TYPE "$(cat {file})"`, with the TYPE that its '
        "first line names; a bag is played with `ros2 bag play {file}`. Points have position, "
        "velocity and acceleration: the controller has to interpolate with quintic polynomials "
        "(joint_trajectory_controller does: interpolation_method splines). For a platform the "
        "message holds the TCP's position, a quaternion (x, y, z, w), and twists in the base frame."
    ),
    units="m",
    angles="rad",
    axes={"strut": numbered("strut_"), "pose": POSE_AXES},
    written_times=rounded_times(_TIME_DIGITS),
)
