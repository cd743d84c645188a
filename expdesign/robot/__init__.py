"""The hexapod in numbers: kinematics, parameter-linear dynamics and limits of many states."""

from expdesign.robot.limit_model import LimitModel, load_robot, robot_from
from expdesign.robot.robot import ForwardKinematicsError, Robot

__all__ = ["ForwardKinematicsError", "LimitModel", "Robot", "load_robot", "robot_from"]
