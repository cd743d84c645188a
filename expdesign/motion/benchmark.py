"""Benchmark motions: circle, line, spline, and their mirror images, as periodic series."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration, ValidationMotion
from expdesign.configuration.experiment import BenchmarkMotion
from expdesign.configuration.schema import MOST_SAMPLES, require_at_most
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck.certificate import recheck
from expdesign.robot import LimitModel, Robot
from expdesign.trajectory import FourierTrajectory, PhaseBasis, round_period

_MIRRORED = {
    # A mirror image turns the other way about the axes in its plane: M R M for R = Rx Ry Rz.
    "none": np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    "xz": np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
    "yz": np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0]),
}
_SPLINE_HARMONICS_PER_POSE = 4
_SPLINE_POINTS = 2048
_SLOWEST = 1e-3
_FASTEST = 1e4


def benchmark_motion(motion: BenchmarkMotion, home: Array, step: float) -> FourierTrajectory:
    """Return a motion as a series whose period is a whole number of controller steps.

    Parameters
    ----------
    motion : BenchmarkMotion
        ``circle`` about the home position, ``line`` to and fro between two poses (more are not
        used), or a closed ``spline`` through its poses; `speed` is that of the TCP: constant on
        the circle, the largest on line and spline.
    home : (6,)
        Home pose; the circle keeps its orientation.
    step : float
        Of the controller, s.

    Raises
    ------
    ValueError
        The motion is a recorded file, or its poses do not move the TCP.
    """
    makers = {"circle": _circle, "line": _line, "spline": _spline}
    if motion.motion not in makers:
        raise ValueError(f"the motion '{motion.motion}' is recorded, not computed")
    unit = makers[motion.motion](motion, home)
    # Built for ω = 1 rad/s: speed grows with ω.
    rates = unit.sample(unit.sample_times(_SPLINE_POINTS)).rate
    fastest = float(np.max(np.linalg.norm(rates[:, :3], axis=1)))
    if not fastest > 0:
        raise ValueError("its poses do not move the TCP: no speed can be kept")
    omega, _ = round_period(motion.speed / fastest, (_SLOWEST, _FASTEST), step)
    signs = _MIRRORED[motion.mirror]
    return FourierTrajectory.from_displacements(
        omega,
        signs * unit.lambda0,
        signs[:, None] * unit.sine,
        signs[:, None] * unit.cosine,
    )


def motion_of_run(
    configuration: RunConfiguration, motion: BenchmarkMotion, home: Array, key: str
) -> FourierTrajectory:
    """Return the motion of a key of the run file.

    Raises
    ------
    InputError
        The motion cannot be computed.
    """
    try:
        return benchmark_motion(motion, home, configuration.run.controller_period)
    except ValueError as error:
        raise InputError(str(error), file=configuration.file, key=key) from error


def refuse_unfit_motions(configuration: RunConfiguration, home: Array) -> None:
    """Refuse motions that cannot be computed, or that need too many samples."""
    for number, motion in enumerate(configuration.run.validation, start=1):
        if motion.motion == "file":
            continue
        key, sampling = f"validate[{number}]", configuration.run.experiment.sampling
        period = motion_of_run(configuration, motion, home, key).period
        made = f"{motion.periods} periods of {period:.4g} s at {sampling:g} Hz"
        count = motion.periods * period * sampling
        require_at_most(count, MOST_SAMPLES, made, configuration.file, f"{key}.periods")


def broken_limits(robot: Robot, trajectory: FourierTrajectory, name: str) -> list[str]:
    """Return a warning if a motion breaks a limit of the robot."""
    check = recheck(LimitModel.of(robot), trajectory)
    if check.passed:
        return []
    worst = max(check.limits, key=lambda limit: limit.violation)
    return [
        f"{name}: the motion breaks {worst.key} ({worst.row}: {worst.value:.4g} "
        f"{worst.unit}, bound {worst.bound:.4g}); a real machine could not make it"
    ]


def motion_name(motion: BenchmarkMotion) -> str:
    """Return the name of a motion: its kind or file, and its mirror plane."""
    name: str = motion.motion
    if isinstance(motion, ValidationMotion) and motion.motion == "file":
        name = Path(str(motion.file)).name
    return name if motion.mirror == "none" else f"{name}, mirrored {motion.mirror}"


def _circle(motion: BenchmarkMotion, home: Array) -> FourierTrajectory:
    """Return a counter-clockwise circle about the normal, from the direction of +x."""
    normal = np.asarray(motion.normal, dtype=float)
    normal = normal / np.linalg.norm(normal)
    first = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    if np.linalg.norm(first) < 1e-9:  # noqa: PLR2004 - the normal is the x axis itself
        first = np.array([0.0, 1.0, 0.0])
    first = first / np.linalg.norm(first)
    sine, cosine = np.zeros((2, COORDINATES, 1))
    cosine[:3, 0] = motion.radius * first
    sine[:3, 0] = motion.radius * np.cross(normal, first)
    return FourierTrajectory.from_displacements(1.0, home, sine, cosine)


def _line(motion: BenchmarkMotion, _home: Array) -> FourierTrajectory:
    ends = np.asarray(motion.poses, dtype=float)[:2]
    cosine = (ends[0] - ends[1])[:, None] / 2
    return FourierTrajectory.from_displacements(
        1.0, ends.mean(axis=0), np.zeros_like(cosine), cosine
    )


def _spline(motion: BenchmarkMotion, _home: Array) -> FourierTrajectory:
    """Fit a series to a periodic cubic spline, with times proportional to the distances."""
    poses = np.asarray(motion.poses, dtype=float)
    closed = np.concatenate([poses, poses[:1]])
    way = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    if not np.all(way > 0):
        raise ValueError("two poses that follow each other are the same")
    knots = np.concatenate([[0.0], np.cumsum(way)]) * 2 * np.pi / way.sum()
    spline = scipy.interpolate.CubicSpline(knots, closed, bc_type="periodic")
    phases = 2 * np.pi * np.arange(_SPLINE_POINTS) / _SPLINE_POINTS
    harmonics = _SPLINE_HARMONICS_PER_POSE * len(poses)
    basis = PhaseBasis.at(phases, harmonics).value
    table = np.linalg.lstsq(basis, spline(phases), rcond=None)[0].T
    return FourierTrajectory.from_displacements(
        1.0, table[:, 0], table[:, 1 : harmonics + 1], table[:, harmonics + 1 :]
    )
