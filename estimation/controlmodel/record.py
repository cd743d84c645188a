"""`model.json`: what a control model is, where it comes from and what was measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from estimation.controlmodel.compiler import SelfTest
from estimation.controlmodel.model import Origin
from estimation.controlmodel.uncertainty import WRITTEN_BY, ActuatorUncertainty
from expdesign.runfolder import JsonFile, described


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlModelFile(JsonFile):
    """`model.json` in the folder of one format."""

    FILE: ClassVar[str] = "model.json"
    WRITTEN_BY: ClassVar[str] = WRITTEN_BY
    units: Annotated[str, described("", "of all values")] = "SI and radians"
    model_format: Annotated[str, described("", "c, python, fmu or simulink")]
    title: Annotated[str, described("", "the format in words")]
    robot: Annotated[str, described("", "name of the robot")]
    prefix: Annotated[str, described("", "with which the names in the files begin")]
    origin: Annotated[Origin, described("", "where the numbers come from")]
    sign_width: Annotated[
        float, described("m/s", "width of the sign of dry friction; 0: the exact one")
    ]
    files: Annotated[dict[str, str], described("", "SHA-256 by name")]
    tests: Annotated[
        tuple[SelfTest, ...], described("", "self-tests that were run here; empty: none")
    ]
    untested: Annotated[str, described("", "why none was run; empty when one was")]
    uncertainty: Annotated[
        tuple[ActuatorUncertainty, ...],
        described("", "of the forces along the motion, by actuator; empty: not known"),
    ]
    motion: Annotated[str, described("", "that the uncertainty is stated on; empty: none")]
