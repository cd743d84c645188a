"""Hexapods of the controller Go Motion: joints, limits and units in one INI file.

``[SERVO_n] PK_PARAMETERS`` has x y z of a strut's joint on the base, then on the platform; poses
are x y z roll pitch yaw about fixed axes; ``[GOMOTION]`` has the units of a metre and of a radian.
Source: NIST's gomotion, etc/genhex.ini and genhexkins.c.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.document import read_text
from expdesign.configuration.errors import InputError
from expdesign.machines.machine import MachineDraft, MachineFormat, Question, rows
from expdesign.machines.readers.linuxcnc import (
    IniFile,
    read_ini,
    real_end,
    strut_limits,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import ANGLES, FIXED_AXES

_SECTION = "GOMOTION"
_KINEMATICS = "genhexkins"
_SERVOS = [f"SERVO_{j}" for j in range(1, ACTUATORS + 1)]
_LIMITS = {"MAX_VEL": "strut_speed", "MAX_ACC": "strut_acceleration"}


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    ini = read_ini(files[0])
    kinematics = ini.entry("TRAJ", "KINEMATICS")
    if kinematics is not None and kinematics.value.split()[:1] != [_KINEMATICS]:
        raise kinematics.refusal("these kinematics are not read", _KINEMATICS)
    (metre,) = _numbers(ini, _SECTION, "LENGTH_UNITS_PER_M", 1)
    (radian,) = _numbers(ini, _SECTION, "ANGLE_UNITS_PER_RAD", 1)
    if min(metre, radian) <= 0:
        message = "its units per metre and per radian are not positive"
        raise InputError(message, files[0], key=f"[{_SECTION}]", allowed="as 100 for centimetres")
    joints = np.array([_numbers(ini, servo, "PK_PARAMETERS", 6) for servo in _SERVOS]) / metre
    home = None
    if ini.entry("TRAJ", "HOME") is not None:
        pose = _numbers(ini, "TRAJ", "HOME", 6)
        angles = Rotation.from_euler(FIXED_AXES, pose[3:] / radian).as_euler(ANGLES) + 0.0
        home = (*rows(pose[None, :3] / metre)[0], *angles.tolist())
    size = float(np.max(np.linalg.norm([*joints.reshape(-1, 3), (home or joints[0])[:3]], axis=1)))
    limits, questions = strut_limits(ini, _SERVOS, _LIMITS, lambda v: float(v / metre), size)
    if all(ini.entry("TRAJ", key) is not None for key in ("MIN_LIMIT", "MAX_LIMIT")):
        low, high = (_numbers(ini, "TRAJ", key, 6) for key in ("MIN_LIMIT", "MAX_LIMIT"))
        ends = np.transpose([low, high])[:3] / metre
        position = {
            letter: tuple(pair)
            for letter, pair in zip("xyz", ends.tolist(), strict=True)
            if pair[0] < pair[1] and None not in [real_end(end, size) for end in pair]
        }
        if position:
            limits["position"] = position
        if len(position) < len(ends):
            left_out = " and ".join(letter for letter in "xyz" if letter not in position)
            text = (
                f"[TRAJ]MIN_LIMIT and MAX_LIMIT of {left_out} are placeholders such as ±1000, "
                "which limit nothing. How far may the platform go?"
            )
            questions.append(Question("limits.position", text))
        text = (
            "The file limits roll, pitch and yaw about fixed axes; phi, theta, psi have another "
            "order. Which rotations may the platform make?"
        )
        questions.append(Question("limits.rotation", text))
    return MachineDraft(
        name=name,
        source=f"Go Motion, {_KINEMATICS}: {files[0].name}",
        base_joints=rows(joints[:, :3]),
        platform_joints=rows(joints[:, 3:]),
        home=home,
        limits=limits,
        questions=tuple(questions),
    )


def _numbers(ini: IniFile, section: str, key: str, count: int) -> Array:
    entry = ini.entry(section, key)
    if entry is None:
        message = f"{key} is missing"
        raise InputError(message, ini.file, key=f"[{section}]", allowed=f"{count} numbers")
    words = entry.value.partition(";")[0].split()
    if len(words) != count:
        raise entry.refusal(f"{len(words)} numbers", f"{count} numbers")
    return np.array([entry.number(word) for word in words])


def _claims(path: Path) -> bool:
    return f"[{_SECTION}]" in read_text(path, "an INI file")


FORMAT = MachineFormat("Go Motion's INI", (".ini",), _read, _claims)
