"""What an FMU and an S-function take and give: blocks of six numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.model import ControlModel
from expdesign.mechanism.hexapod import ACTUATORS, POSE, numbered

OUTPUTS = (
    ("forces", "N", "force of actuator"),
    ("rest", "N", "force that holds the platform still, actuator"),
    ("friction", "N", "the friction's share of the force, actuator"),
    ("lengths", "m", "coordinate of actuator"),
    ("rates", "m/s", "speed of actuator"),
)
"""Of the pose, its rate and acceleration: name, unit and meaning."""
REASONS = (
    "the struts cannot hold the platform in this pose",
    "no pose of the measured lengths was found in which the struts hold the platform",
    "the pose of the measured lengths is turned by more than 45 deg from the one before",
)
"""What a status of the C functions says, from 1. The search meets the first one's poses on its way;
where it ends in one it says the second."""


class Variable(NamedTuple):
    """One number of a block."""

    name: str
    unit: str
    meaning: str
    start: float


@dataclass(frozen=True, eq=False)
class Block:
    """Six numbers that belong together."""

    name: str
    unit: str
    """Of an actuator's numbers; of those of the pose what follows the coordinate's own."""
    meaning: str
    """What comes before the coordinate's meaning, or the number of the actuator."""
    causality: Literal["input", "output", "parameter"]
    of: tuple[str, ...] = ()
    """Of an output: the inputs that it depends on."""
    start: Array | None = None
    """Of what is no output; None: zeros."""
    of_pose: bool = False
    """Whether there is one for each coordinate of the pose; else one for each actuator."""

    @property
    def variables(self) -> list[Variable]:
        """Its numbers one by one."""
        start = np.zeros(ACTUATORS) if self.start is None else self.start
        if self.of_pose:
            each = [
                (
                    f"{self.name}.{one.name}",
                    f"{one.unit}{self.unit}",
                    f"{self.meaning}{one.meaning}",
                )
                for one in POSE
            ]
        else:
            each = [(f"{self.name}[{j}]", self.unit, f"{self.meaning} {j}") for j in numbered("")]
        return [Variable(*one, value) for one, value in zip(each, start.tolist(), strict=True)]


def blocks(model: ControlModel) -> tuple[Block, ...]:
    """Return all blocks in their order.

    The last ones are of the forward kinematics, which need nothing of what comes before.
    """
    home, functions = model.robot.home, model.functions
    lengths = model.robot.inverse_kinematics(home)
    return (
        Block("pose", "", "", "input", start=home, of_pose=True),
        Block("rate", "/s", "rate of ", "input", of_pose=True),
        Block("acceleration", "/s2", "acceleration of ", "input", of_pose=True),
        *(Block(*one, "output", functions[one[0]].inputs) for one in OUTPUTS),
        Block("measured_lengths", "m", "measured coordinate of actuator", "input", start=lengths),
        Block("measured_rates", "m/s", "measured speed of actuator", "input"),
        Block(
            "measured_pose",
            "",
            "of the measured coordinates: ",
            "output",
            ("measured_lengths",),
            of_pose=True,
        ),
        Block(
            "measured_rate",
            "/s",
            "of the measured coordinates and speeds: rate of ",
            "output",
            ("measured_lengths", "measured_rates"),
            of_pose=True,
        ),
        Block(
            "start_pose",
            "",
            "where the first search for the measured pose begins: ",
            "parameter",
            start=home,
            of_pose=True,
        ),
    )
