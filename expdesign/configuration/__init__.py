"""Configuration: from YAML files to complete, validated descriptions in SI units."""

from expdesign.configuration.finding import find_robot, find_run
from expdesign.configuration.geometry import condition_at_home, home_geometry, shared_joint_pairs
from expdesign.configuration.problem import ConfigurationError, Problem
from expdesign.configuration.resolved import (
    ResolvedLimit,
    ResolvedNoise,
    ResolvedRobot,
    RunConfiguration,
)
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.run import load_run
from expdesign.configuration.smoothing import smoothing_widths
from expdesign.configuration.writing import resolved_yaml

__all__ = [
    "ConfigurationError",
    "Problem",
    "ResolvedLimit",
    "ResolvedNoise",
    "ResolvedRobot",
    "RunConfiguration",
    "condition_at_home",
    "find_robot",
    "find_run",
    "home_geometry",
    "load_robot_description",
    "load_run",
    "resolved_yaml",
    "shared_joint_pairs",
    "smoothing_widths",
]
