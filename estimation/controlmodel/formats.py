"""Formats of control models: their files, and self-tests on this computer."""

from __future__ import annotations

import hashlib
import io
import os
import platform
import re
import shutil
import subprocess
import sys
import uuid
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.model import (
    VECTORS,
    WRITTEN_BY,
    ControlModel,
    Origin,
    model_functions,
)
from estimation.controlmodel.rendering import NUMPY, C, context, render_template
from estimation.uncertainty.forces import ActuatorForce
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import ACTUATORS, POSE, actuator_names
from expdesign.runfolder import JsonFile, described

OUTPUTS = (
    ("forces", "N", "force of actuator"),
    ("rest", "N", "force that holds the platform still, actuator"),
    ("friction", "N", "the friction's share of the force, actuator"),
    ("lengths", "m", "coordinate of actuator"),
    ("rates", "m/s", "speed of actuator"),
)
"""Outputs for pose, rate and acceleration: name, unit and meaning."""
REASONS = (
    "the struts cannot hold the platform in this pose",
    "no pose of the measured lengths was found in which the struts hold the platform",
    "the pose of the measured lengths is turned by more than 45 deg from the one before",
    "an argument or a result is infinite or not a number",
)
"""Meanings of the status of the C functions, from 1. The search may pass poses of the first kind;
if it ends in one, the status is the second."""


class Variable(NamedTuple):
    """One number of a block."""

    name: str
    unit: str
    meaning: str
    start: float


@dataclass(frozen=True, eq=False)
class Block:
    """A vector of six numbers."""

    name: str
    unit: str
    """Unit of an actuator's number; for the pose, the suffix of the coordinate's unit."""
    meaning: str
    """Text before the coordinate's meaning, or before the number of the actuator."""
    causality: Literal["input", "output", "parameter"]
    of: tuple[str, ...] = ()
    """Inputs on which an output depends."""
    start: Array | None = None
    """Start values of an input or parameter; None: zeros."""
    of_pose: bool = False
    """One number for each coordinate of the pose; otherwise one for each actuator."""

    @property
    def variables(self) -> list[Variable]:
        """The single numbers."""
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
            each = [
                (f"{self.name}[{j}]", self.unit, f"{self.meaning} {j}") for j in actuator_names("")
            ]
        return [Variable(*one, value) for one, value in zip(each, start.tolist(), strict=True)]


def blocks(model: ControlModel) -> tuple[Block, ...]:
    """Return all blocks in their order; the last ones belong to the forward kinematics."""
    home, functions = model.robot.home, model_functions(model.robot.terms)
    lengths = model.robot.inverse_kinematics(home)
    torques = Block("torques", "N m", "torque of motor", "output", functions["forces"].inputs)
    return (
        Block("pose", "", "", "input", start=home, of_pose=True),
        Block("rate", "/s", "rate of ", "input", of_pose=True),
        Block("acceleration", "/s2", "acceleration of ", "input", of_pose=True),
        *(Block(*one, "output", functions[one[0]].inputs) for one in OUTPUTS),
        *(() if model.torque_per_force is None else (torques,)),
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


_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""Time stamp in an archive, so that equal models have equal bytes."""


@dataclass(frozen=True)
class ModelFiles:
    """Files of a model, by name, with the results of their self-tests here."""

    files: Mapping[str, bytes]
    tests: tuple[SelfTest, ...] = ()
    untested: str = ""
    """Reason for a missing self-test; otherwise empty."""


@dataclass(frozen=True)
class ModelFormat:
    """A format of control models."""

    title: str
    make: Callable[[ControlModel, Path], ModelFiles]
    """Function that creates the files of a model; it may use the given empty folder."""


def _c(model: ControlModel, folder: Path) -> ModelFiles:
    filled = context(model, C)
    files = _c_files(model, filled) | {"Makefile": render_template("Makefile.j2", filled)}
    return _self_test_report(model, files, folder)


def _simulink(model: ControlModel, folder: Path) -> ModelFiles:
    filled = context(model, C) | _signals(model)
    name = model.prefix
    own = {
        f"{name}_sfun.c": render_template("sfunction.c.j2", filled),
        f"build_{name}.m": render_template("build.m.j2", filled),
    }
    made = _self_test_report(model, _c_files(model, filled), folder)
    return replace(made, files={**made.files, **own})


def _python(model: ControlModel, folder: Path) -> ModelFiles:
    name = f"{model.prefix}.py"
    files = {name: render_template("module.py.j2", context(model, NUMPY))}
    _put(folder, files, model)
    by = f"Python {platform.python_version()}"
    return ModelFiles(files, (run_self_test([sys.executable, name], folder, "double", by),))


def _fmu(model: ControlModel, folder: Path) -> ModelFiles:
    compiler, (place, suffix) = find_compiler(), _binaries()
    if compiler is None:
        raise ComputationError(
            "an FMU holds machine code, and there is no C compiler here: install gcc or clang, or "
            "name one in CC. The format c needs none"
        )
    filled, name = context(model, C), model.prefix
    sources = _c_files(model, filled)
    # Different units have different identifiers.
    guid = "{" + str(uuid.uuid5(uuid.NAMESPACE_URL, _digest(sources[f"{name}.c"]))) + "}"
    filled |= {"guid": guid} | _signals(model)
    wrapper = f"{name}_fmu.c"
    made = _self_test_report(
        model, sources | {wrapper: render_template("fmu.c.j2", filled)}, folder
    )
    library = f"{name}{suffix}"
    flags = ("-shared", "-fPIC", "-fvisibility=hidden")
    build(compiler, folder, (f"{name}.c", wrapper), library, *flags)
    archive = {
        "modelDescription.xml": render_template("modelDescription.xml.j2", filled),
        f"binaries/{place}/{library}": (folder / library).read_bytes(),
        **{f"sources/{file}": made.files[file] for file in (f"{name}.c", f"{name}.h", wrapper)},
    }
    return replace(made, files={f"{name}.fmu": _zip_files(archive)})


FORMATS = {
    "c": ModelFormat("C99 for controllers, double or single precision", _c),
    "python": ModelFormat("a Python module that needs NumPy alone", _python),
    "fmu": ModelFormat("FMI 2.0 for co-simulation, with machine code and source", _fmu),
    "simulink": ModelFormat("level-2 S-function for Simulink, with its C code", _simulink),
}
"""By name. A new one is a function and an entry here."""


def _signals(model: ControlModel) -> dict[str, Any]:
    signals = blocks(model)
    first = {one.name: ACTUATORS * k for k, one in enumerate(signals)}
    ports = {
        f"{kind}s": [one.name for one in signals if one.causality == kind]
        for kind in ("input", "output")
    }
    return {"blocks": signals, "first": first, "reasons": REASONS, **ports}


def _c_files(model: ControlModel, filled: dict[str, Any]) -> dict[str, bytes]:
    return {
        f"{model.prefix}{ending}": render_template(template, filled)
        for ending, template in (
            (".h", "model.h.j2"),
            (".c", "model.c.j2"),
            ("_vectors.h", "vectors.h.j2"),
            ("_selftest.c", "selftest.c.j2"),
        )
    }


def _self_test_report(model: ControlModel, files: dict[str, bytes], folder: Path) -> ModelFiles:
    """Build the self-test in double and single precision, and run both; none without compiler."""
    _put(folder, files, model)
    compiler = find_compiler()
    if compiler is None:
        return ModelFiles(
            files, untested="there is no C compiler here: neither tested nor measured"
        )
    sources = f"{model.prefix}.c", f"{model.prefix}_selftest.c"
    said = _run([compiler, "--version"], Path.cwd()).stdout.splitlines()
    by = said[0] if said else Path(compiler).name
    tests = []
    for precision, flags in (("double", ()), ("float", ("-DEXPDESIGN_FLOAT",))):
        program = f"selftest-{precision}"
        build(compiler, folder, sources, program, *flags)
        tests.append(run_self_test([str(folder / program)], folder, precision, by))
    return ModelFiles(files, tuple(tests))


def _put(folder: Path, files: Mapping[str, bytes], model: ControlModel) -> None:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    VECTORS.write(folder, model.vectors)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _binaries() -> tuple[str, str]:
    """Return the folder and the suffix of FMI 2.0 for the machine code of this machine."""
    known = {
        ("Linux", "x86_64"): ("linux64", ".so"),
        ("Darwin", "x86_64"): ("darwin64", ".dylib"),
    }
    system = (platform.system(), platform.machine())
    if system not in known:
        raise ComputationError(
            f"FMI 2.0 names no folder for the machine code of {' '.join(system)}: make the FMU on "
            "Linux or macOS on x86_64, or take the format c"
        )
    return known[system]


def _zip_files(files: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _EARLIEST)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content)
    return stream.getvalue()


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
    torque_per_force: Annotated[
        float | None,
        described("N m/N", "of the motors; null: the robot file states no lead of the drives"),
    ]
    files: Annotated[dict[str, str], described("", "SHA-256 by name")]
    tests: Annotated[
        tuple[SelfTest, ...], described("", "self-tests that were run here; empty: none")
    ]
    untested: Annotated[str, described("", "why none was run; empty when one was")]
    uncertainty: Annotated[
        tuple[ActuatorForce, ...],
        described("", "forces along the motion, by actuator; empty: not known"),
    ]
    motion: Annotated[str, described("", "that the uncertainty is stated on; empty: none")]
    doubts: Annotated[
        tuple[str, ...],
        described("", "parameters that are impossible or not identified, with advice"),
    ] = ()


FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
_NAMES = ("cc", "gcc", "clang")
_PATIENCE = 300.0
"""Seconds that a compiler or a self-test may take."""
_STATES = re.compile(r", (\d+) states$", re.MULTILINE)
_DEVIATION = re.compile(r"^forces +worst deviation ([^\s,]+)", re.MULTILINE)
_TIME = re.compile(r"^forces +median (\S+) us, 99.9 % (\S+) us, worst (\S+) us", re.MULTILINE)


@dataclass(frozen=True)
class SelfTest:
    """Result of a self-test on this computer."""

    precision: Annotated[str, described("", "double or float")]
    compiler: Annotated[str, described("", "that built it, or Python, with its version")]
    states: Annotated[int, described("1", "number of states that were compared")]
    deviation: Annotated[float, described("N", "worst deviation of a force from expdesign's")]
    median: Annotated[float | None, described("s", "of the time of a call; null: not measured")]
    most: Annotated[float | None, described("s", "duration that 99.9 % of the calls do not exceed")]
    worst: Annotated[
        float | None, described("s", "longest call, including other load of the computer")
    ]


def find_compiler() -> str | None:
    """Return the C compiler: that of ``CC``, else cc, gcc or clang; None without any."""
    named = os.environ.get("CC")
    return next(filter(None, map(shutil.which, (named,) if named else _NAMES)), None)


def build(compiler: str, folder: Path, sources: Sequence[str], target: str, *flags: str) -> None:
    """Compile sources of a folder to a file there, without any warning.

    Raises
    ------
    ComputationError
        The compiler refuses.
    """
    command = [compiler, *FLAGS, *flags, "-o", target, *sources, "-lm"]
    done = _run(command, folder)
    if done.returncode:
        raise ComputationError(f"{' '.join(command)} failed: {done.stderr.strip()[-2000:]}")


def run_self_test(command: Sequence[str], folder: Path, precision: str, by: str) -> SelfTest:
    """Run a compiled self-test and return its result.

    Raises
    ------
    ComputationError
        It fails.
    """
    done = _run(command, folder)
    states, deviation, time = (one.search(done.stdout) for one in (_STATES, _DEVIATION, _TIME))
    if done.returncode or states is None or deviation is None:
        raise ComputationError(
            f"the self-test of the model ({precision}, {by}) failed: "
            f"{(done.stdout + done.stderr).strip()[-2000:]}"
        )
    times = [None] * 3 if time is None else [1e-6 * float(one) for one in time.groups()]
    return SelfTest(precision, by, int(states[1]), float(deviation[1]), *times)


def _run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PATIENCE,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ComputationError(f"{' '.join(command)} cannot be run: {error}") from error
