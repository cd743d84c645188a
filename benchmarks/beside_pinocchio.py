"""PaLiDA's regressor beside Pinocchio's: the same bodies in the same states, in turns.

Pinocchio runs in a process of its own (`pinocchio_regressor.py`). EXPDESIGN_PINOCCHIO names a
Python that has the package, which is none of this project's:

    python -m venv /tmp/pinocchio && /tmp/pinocchio/bin/pip install pin
    EXPDESIGN_PINOCCHIO=/tmp/pinocchio/bin/python make bench ARGS="speed pinocchio"

Wheels of it are for any x86-64 processor, machine code here is for the one that it runs on. Each
figure is CPU time where it is least, so that other work on the machine counts little. Pinocchio
takes q, q̇ and q̈ of all 24 coordinates as given; A begins at the pose and is that of the actuators.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from expdesign.configuration import load_run
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot, load_robot, robot_from
from tests.multibody.driven import motion
from tests.multibody.machine import Bodies, Geometry

PYTHON = "EXPDESIGN_PINOCCHIO"
"""Variable of the environment: a Python that has Pinocchio; by default the present one."""
STATES = 2000
_ALIKE = 1e-9
"""Of the largest force, below which two forces are the same."""
_LONG_ENOUGH = 0.5
"""Seconds for each figure."""
_DESIGN = Path(__file__).parent / "designs" / "palida.json"


@dataclass(frozen=True)
class Measured:
    """What was found."""

    version: str
    """Of Pinocchio."""
    largest: float
    apart: float
    """Largest force, and largest difference of two forces in parts of it, N."""
    taken: dict[str, list[float]]
    """µs a state, each time: ``tree`` and ``actuators`` of Pinocchio, A of the bodies
    alone, ``rigid``, and with ``friction``."""


def beside_pinocchio(repetitions: int) -> Measured | None:
    """Measure both; None where there is no Pinocchio.

    Raises
    ------
    RuntimeError
        The forces are not the same.
    """
    python = os.environ.get(PYTHON, sys.executable)
    probe = subprocess.run([python, "-c", "import pinocchio"], capture_output=True, check=False)
    if probe.returncode:
        print(
            f"{python} has no Pinocchio: nothing is compared. `python -m venv DIR` and "
            f"`DIR/bin/pip install pin` make one that has it, {PYTHON}=DIR/bin/python names it"
        )
        return None
    robot = load_robot("palida")
    geometry = Geometry.of(robot)
    none = (0.0,) * ACTUATORS
    bodies = Bodies(cardan_friction=none[:2], dry_friction=none, viscous_friction=none)
    design = json.loads(_DESIGN.read_text())
    pose, rate, acceleration = motion(
        design, 2 * np.pi / design["omega"] * np.arange(STATES) / STATES
    )
    states = pose, rate, acceleration
    moved = robot.strut_motion(*states)
    struts = np.stack([moved.alpha, moved.beta, moved.length], axis=2)
    parts = ("platform", "ring", "stator", "slider")
    places = np.concatenate([robot.cardan_frames, geometry.base_joints[:, :, None]], axis=2)
    given = {
        "machine": {
            "gravity": geometry.gravity.tolist(),
            "platform_joints": geometry.platform_joints.tolist(),
            "frames": places.tolist(),
            "bodies": {part: astuple(getattr(bodies, part)) for part in parts},
        },
        "states": [each.tolist() for each in (*states, struts)],
    }
    parameters = bodies.parameters(geometry.platform_joints)
    forces = robot.actuator_forces(*states, parameters=parameters)
    rigid = _without_friction(robot)
    own = {"rigid": rigid.regressor, "friction": robot.regressor}
    taken: dict[str, list[float]] = {name: [] for name in (*own, "tree", "actuators")}
    version, apart = "", 0.0
    for _ in range(repetitions):
        for name, regressor in own.items():
            taken[name].append(_fastest(partial(regressor, *states)))
        done = subprocess.run(
            [python, Path(__file__).with_name("pinocchio_regressor.py")],
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            input=json.dumps(given),
            capture_output=True,
            text=True,
            check=True,
        )
        found = json.loads(done.stdout)
        version = found["version"]
        apart = np.abs(np.array(found["forces"]) - forces).max() / np.abs(forces).max()
        if not apart < _ALIKE:
            raise RuntimeError(f"the forces differ by {apart:.1g} of the largest one")
        for name in ("tree", "actuators"):
            taken[name].append(found[name])
    return Measured(version, float(np.abs(forces).max()), float(apart), taken)


def _without_friction(robot: Robot) -> Robot:
    """Return the rigid bodies of a robot alone."""
    about = robot.description.description.model_dump(mode="json", by_alias=True)
    names = {name for name in robot.parameter_names if name.startswith("p")}
    about |= {
        "terms": ["struts", "rigid_platform"],
        "parameters": {k: v for k, v in about["parameters"].items() if k in names},
    }
    return robot_from(load_run({"name": "rigid", "robot": about}).robot)


def _fastest(function: Callable[[], object]) -> float:
    """Return what a state takes, µs of CPU time, in the fastest of many calls for all of them."""
    least, end = np.inf, time.process_time() + _LONG_ENOUGH
    while time.process_time() < end:
        began = time.process_time()
        function()
        least = min(least, time.process_time() - began)
    return least / STATES * 1e6
