"""Where the machines' files are, and lengths by a formula that is not ours."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from expdesign.configuration.geometry import geometry_at

FOLDER = Path(__file__).parent / "machines"


def lengths(machine, pose):
    """Return what the model has for the struts of a machine at a pose, (6,), m."""
    base, platform = np.array(machine.base_joints), np.array(machine.platform_joints)
    return geometry_at(np.array(pose), base, platform).lengths


def moving_axes(rotation):
    """Return phi, theta, psi of a SciPy rotation, rad."""
    return rotation.as_euler("XYZ")


def fixed_axes(roll_pitch_yaw, degrees=False):
    """Return the rotation by roll, pitch and yaw about fixed axes."""
    return Rotation.from_euler("xyz", roll_pitch_yaw, degrees=degrees)


def asked(machine):
    """Return the keys that questions stand beside."""
    return {question.key for question in machine.questions}
