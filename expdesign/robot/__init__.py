"""The hexapod: geometry, kinematics and the parameter-linear dynamics as one symbolic graph."""

from expdesign.mechanism.graph import Friction, HexapodGraph, hexapod_graph
from expdesign.robot.exact_limits import ExactModel
from expdesign.robot.forward import ForwardKinematicsError
from expdesign.robot.loading import load_robot, robot_from
from expdesign.robot.robot import Robot, StrutMotion

__all__ = [
    "ExactModel",
    "ForwardKinematicsError",
    "Friction",
    "HexapodGraph",
    "Robot",
    "StrutMotion",
    "hexapod_graph",
    "load_robot",
    "robot_from",
]
