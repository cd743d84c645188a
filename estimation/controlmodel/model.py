"""A control model: a robot, where its numbers come from, and how sure they are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from estimation.controlmodel.functions import ModelFunction, model_functions
from estimation.controlmodel.uncertainty import ForceUncertainty
from estimation.controlmodel.vectors import Vectors, vectors_of
from expdesign.configuration.identification import Identification, machine_name
from expdesign.robot import Robot
from expdesign.runfolder import described

_COUNT, _SEED = 100, 0
"""States that a format tests itself with."""

DOUBLE, SINGLE = 4e-12, 1e-5
"""Deviation of a force that is allowed in double and single precision, as a share of the largest:
1e-9 N and 2.3 mN of 230 N."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a model's numbers."""

    file: Annotated[str, described("", "the robot file")]
    sha256: Annotated[str, described("", "its SHA-256")]
    made: Annotated[str, described("", "when the estimate ended, UTC; empty: not known")]
    version: Annotated[str, described("", "version of expdesign that made the model")]
    run: Annotated[str, described("", "run of the estimate; empty: not from an estimate")] = ""
    estimator: Annotated[str, described("", "ls, gm or ml")] = ""
    verdict: Annotated[str, described("", "what its diagnostics say")] = ""

    @property
    def sentence(self) -> str:
        """The same in words."""
        if not self.run:
            return f"nominal values of {self.file}: no estimate"
        when = f", {self.made}" if self.made else ""
        return f"run {self.run}, estimator {self.estimator}, verdict: {self.verdict}{when}"


@dataclass(frozen=True, eq=False)
class ControlModel:
    """Common input of all formats."""

    robot: Robot
    origin: Origin
    width: float
    """Of the sign of dry friction, m/s; 0: the exact one."""
    uncertainty: ForceUncertainty | None = None
    """Along a motion; None without an estimate or a motion."""

    @property
    def prefix(self) -> str:
        """The robot's name as an identifier of C, with which all names begin."""
        name = re.sub(r"\W", "_", machine_name(self.robot.name), flags=re.ASCII)
        return f"{'robot_' if name[0].isdigit() else ''}{name}_model"

    @property
    def identification(self) -> Identification | None:
        """How the robot's values are known."""
        return self.robot.description.description.identification

    @property
    def functions(self) -> dict[str, ModelFunction]:
        """Functions of the model."""
        return dict(model_functions(self.robot.terms))

    @cached_property
    def vectors(self) -> Vectors:
        """Test states with the model's outputs."""
        return vectors_of(self.robot, self.width, _COUNT, _SEED)

    @property
    def largest_force(self) -> float:
        """Limit of the actuators' forces, N; where there is none, the largest of the vectors."""
        limit = self.robot.limit("actuator_force")
        return float(abs(self.vectors.forces).max() if limit is None else max(limit.upper))
