"""Energy of a hexapod by the formulas of docs/model.md, without the graph's forces."""

import numpy as np
from scipy.spatial.transform import Rotation


def energy(robot, values, pose, rate):
    """Return kinetic and potential energy together [J].

    Parameters
    ----------
    robot
        With the terms `struts` and `rigid_platform`; others have no energy here.
    values
        (m,), parameters.
    pose, rate
        (6,) [m, rad, per s].
    """
    p = dict(zip(robot.parameter_names, values, strict=True))
    about = robot.description
    struts = robot.strut_motion(pose, rate, np.zeros(6))
    turned = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
    joints = pose[:3] + about.platform_joints @ turned.T
    directions = (joints - about.base_joints) / struts.length[:, None]
    square = np.cos(struts.beta) ** 2
    swing = square * struts.alpha_rate**2 + struts.beta_rate**2
    kinetic = np.sum(
        p["p1"] / 2 * struts.alpha_rate**2
        + p["p2"] / 2 * square * struts.alpha_rate**2
        + p["p3"] / 2 * struts.beta_rate**2
        + p["p5"] * struts.length * swing
    )
    potential = -(p["p4"] + p["p5"]) * np.sum(directions @ about.gravity)
    first = Rotation.from_euler("X", pose[3]).as_matrix()
    second = first @ Rotation.from_euler("Y", pose[4]).as_matrix()
    omega = rate[3] * np.eye(3)[0] + rate[4] * first[:, 1] + rate[5] * second[:, 2]
    moment = turned @ [p.get("sx", 0), p.get("sy", 0), p["p9"]]
    own = turned.T @ omega
    products = [[0, p.get("Ixy", 0), p.get("Ixz", 0)], [0, 0, p.get("Iyz", 0)], [0, 0, 0]]
    inertia = np.diag([p["p6"], p["p7"], p["p8"]]) + products + np.transpose(products)
    kinetic += p["p10"] / 2 * rate[:3] @ rate[:3] + rate[:3] @ np.cross(omega, moment)
    kinetic += own @ inertia @ own / 2
    potential -= about.gravity @ (p["p10"] * pose[:3] + moment)
    return float(kinetic + potential)
