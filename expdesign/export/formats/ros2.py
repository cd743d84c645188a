"""ROS 2: JointTrajectory of the struts or MultiDOFJointTrajectory of the platform."""

from __future__ import annotations

from pathlib import Path

from expdesign.export import ros_bag, ros_yaml
from expdesign.export.definition import POSE_AXES, Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.ros_messages import points_of, rows_of, written_times
from expdesign.export.rows import Rows


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    encoding = ros_bag if settings.section.encoding == "mcap" else ros_yaml
    encoding.write(path, points_of(rows, settings), settings)


def _read(path: Path, settings: Settings) -> Rows:
    encoding = ros_bag if settings.section.encoding == "mcap" else ros_yaml
    return rows_of(encoding.read(path, settings), settings)


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
    axes={"strut": tuple(f"strut_{j}" for j in range(1, 7)), "pose": POSE_AXES},
    written_times=written_times,
)
