"""The numbers of a robot as named constants: what they are called, their comments and values."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.model import ControlModel
from estimation.controlmodel.uncertainty import by_actuator
from expdesign.mechanism.term import parameters_of

_WORDS = {"α": "alpha", "β": "beta", "²": "^2", "·": " ", "–": "-", "…": "..."}


@dataclass(frozen=True, eq=False)
class Constant:
    """An array of numbers of the robot."""

    name: str
    comment: str
    values: Array
    notes: tuple[str, ...] = ()
    """Of every row, or none."""

    @property
    def places(self) -> tuple[str, ...]:
        """What its elements are called in C and Python, row by row."""
        indices = np.ndindex(*self.values.shape)
        return tuple(self.name + "".join(f"[{k}]" for k in index) for index in indices)


def robot_constants(model: ControlModel) -> tuple[Constant, ...]:
    """Return the constants in the order of the inputs of `model_functions`.

    Geometry, constants of the terms, parameters: one array to each piece of `GeometrySymbols`.
    """
    robot = model.robot
    about = robot.description
    geometry = [
        Constant("BASE_JOINTS", "joints at the base, base frame, m", about.base_joints),
        Constant(
            "PLATFORM_JOINTS", "joints at the platform, platform frame, m", about.platform_joints
        ),
        Constant(
            "CARDAN_FRAMES",
            "frames of the cardan joints, columns x y z, base frame",
            robot.cardan_frames,
        ),
        Constant(
            "JOINT_AXES",
            "axes of the joints at the platform, platform frame",
            about.platform_joint_axes,
        ),
        Constant("GRAVITY", "gravity, base frame, m/s^2", about.gravity),
    ]
    if about.platform_cardan_axes is not None:
        geometry += [
            Constant(
                "PLATFORM_CARDAN_AXES",
                "first axes of the cardan joints at the platform, platform frame",
                about.platform_cardan_axes,
            ),
            Constant("LEAD", "lead of the threads, m per turn", np.array([about.thread_lead])),
        ]
    known = [(term, one) for term in robot.terms for one in term.constants]
    return (
        *geometry,
        Constant(
            "CONSTANTS",
            "constants of the terms",
            np.asarray(about.constants, dtype=float),
            tuple(f"{term.name}: {one.name} [{one.unit}]" for term, one in known),
        ),
        Constant(
            "PARAMETERS", "parameters of the dynamics", robot.parameters, tuple(_parameters(model))
        ),
    )


def home(model: ControlModel) -> Constant:
    """Return the home pose."""
    return Constant("HOME", "home pose x y z phi theta psi, m and rad", model.robot.home)


def _parameters(model: ControlModel) -> Iterator[str]:
    known = model.identification
    std = None
    if known is not None:
        variances = np.diag(known.covariance_random) + np.diag(known.covariance_systematic)
        std = np.sqrt(np.maximum(variances, 0.0))
    for k, parameter in enumerate(parameters_of(model.robot.terms)):
        spread = "" if std is None else f", std {std[k]:.2g}"
        yield f"{parameter.name} [{parameter.unit}]{spread}: {plain(parameter.meaning)}"


def plain(text: str) -> str:
    """Return a text in ASCII, without the marks of LaTeX: compilers differ on all else."""
    for letter, word in _WORDS.items():
        text = text.replace(letter, word)
    text = re.sub(r"\\[, ]", " ", re.sub(r"[${}]|\\(?=[a-z])", "", text))
    return text.encode("ascii", "replace").decode("ascii")


def uncertainty_lines(model: ControlModel) -> tuple[str, ...]:
    """Return the standard deviations of the forces in words, one line to an actuator."""
    if model.uncertainty is None:
        return ("not known: no covariance of the parameters, or no motion to state it on",)
    return tuple(
        f"actuator {one.actuator}: rms {one.rms:.3g} N, largest {one.largest:.3g} N, of forces up "
        f"to {one.largest_force:.3g} N"
        for one in by_actuator(model.uncertainty)
    )
