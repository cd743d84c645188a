"""The hexapod: geometry, kinematics and the parameter-linear dynamics as one symbolic graph."""

from expdesign.mechanism.graph import Friction, HexapodGraph, hexapod_graph
from expdesign.robot.forward import ForwardKinematicsError
from expdesign.robot.limit_model import LimitModel
from expdesign.robot.loading import load_robot, robot_from
from expdesign.robot.robot import Robot, StrutMotion

__all__ = [
    "ForwardKinematicsError",
    "Friction",
    "HexapodGraph",
    "LimitModel",
    "Robot",
    "StrutMotion",
    "hexapod_graph",
    "load_robot",
    "robot_from",
]
