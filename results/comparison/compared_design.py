"""Basis of a comparison of designs: information, precision and machine of each.

F of a motion is decided by joints, first cardan axes, gravity, the model and the noise of the
forces. Between machines that differ in one of them, det F differs by the machine and not by the
design. Values of the parameters do not enter F, limits decide which motions are allowed, and home
and names only describe: designs that differ in them are of the same machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.noise import ForceSpectrum
from expdesign.experiment import DesignResult
from expdesign.information.fisher import (
    SingularInformationError,
    log_det,
    parameter_covariance,
)

COUNTED = "joints, first cardan axes, gravity and noise of the forces"
"""Properties of a machine, in words, where the parameters are the same."""

_SAME = 1e-9
"""Difference, relative to the largest number of the kind, up to which machines are the same."""


@dataclass(frozen=True, eq=False)
class ComparedDesign:
    """One design and its name in the comparison."""

    label: str
    result: DesignResult

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that it judges."""
        return self.result.parameter_names

    @property
    def information(self) -> Array:
        """F of one sample on average, SI, (m, m)."""
        return self.result.information / self.result.samples

    @property
    def period(self) -> float:
        """Period, s."""
        return self.result.trajectory.period

    @property
    def nominal(self) -> Array:
        """Nominal values of its parameters for its robot, (m,)."""
        return np.array([parameter.nominal for parameter in self.result.parameters])

    def std(self, samples: float) -> Array:
        """Return the predicted standard deviations for so many samples, (m,), SI; NaN for none.

        They are those of the design's own experiment, which `tables/parameters.csv` states, by
        the square root of the samples.
        """
        own = self.result.predicted_std.experiment.samples
        std = np.array([parameter.std_experiment for parameter in self.result.parameters])
        return np.asarray(std * np.sqrt(own / samples), dtype=np.float64)

    def covariance(self, samples: float) -> Array | None:
        """Return the covariance for so many samples, SI; None when F is singular."""
        try:
            return parameter_covariance(self.information * samples, self.names)
        except SingularInformationError:
            return None

    def log_det(self, samples: float) -> float | None:
        """Return log det F for so many samples, SI; None when F is singular."""
        try:
            return log_det(self.information * samples, self.names)
        except SingularInformationError:
            return None


@dataclass(frozen=True, eq=False)
class DesignComparison:
    """Designs, at least one, on the basis of the first; precision: the relative σ wanted."""

    designs: tuple[ComparedDesign, ...]
    precision: float

    @property
    def comparable(self) -> bool:
        """True when all designs judge the same parameters."""
        return all(design.names == self.designs[0].names for design in self.designs)

    @property
    def samples(self) -> int:
        """Samples that the criteria are stated for: those of the first design's period."""
        return self.designs[0].result.samples

    @property
    def sampling(self) -> float:
        """Sampling rate of the common experiment, Hz."""
        return float(self.designs[0].result.configuration.run.experiment.sampling)

    @property
    def experiment_samples(self) -> int:
        """Samples of the common experiment: the first design's."""
        return self.designs[0].result.predicted_std.experiment.samples

    @property
    def same_nominal(self) -> bool:
        """True when all robots have the same nominal values."""
        first = self.designs[0].nominal
        return all(np.array_equal(design.nominal, first) for design in self.designs)

    @cached_property
    def machines(self) -> tuple[tuple[ComparedDesign, ...], ...]:
        """The designs by machine, in their order."""
        of = machines([design.result.configuration.robot for design in self.designs])
        return tuple(
            tuple(design for design, own in zip(self.designs, of, strict=True) if own == machine)
            for machine in dict.fromkeys(of)
        )

    def differences(self) -> tuple[str, ...]:
        """Return further differences between the designs that affect the comparison."""
        first, found = self.designs[0], []
        if not self.comparable:
            found.append(
                "The designs judge different parameters: their criteria cannot be compared, and "
                "are left out."
            )
        robot = first.result.configuration.robot
        for design in self.designs[1:]:
            own = design.result.configuration.robot
            reasons = differing(robot, own)
            names = f" ({own.name}; {first.label}: {robot.name})" if own.name != robot.name else ""
            if reasons:
                found.append(
                    f"{design.label} was designed for another robot than {first.label}{names}: "
                    f"other {', '.join(reasons)}. Their information differs by the machine and "
                    "not only by the design: no efficiency is stated between them."
                )
            elif names:
                found.append(
                    f"{design.label} was designed for a robot of another name than "
                    f"{first.label}{names}, in what counts the same."
                )
            if self.comparable and not np.array_equal(design.nominal, first.nominal):
                found.append(
                    f"{design.label} has other nominal values than {first.label}: its precision "
                    "is relative to its own."
                )
        return tuple(found)


def differing(one: ResolvedRobot, other: ResolvedRobot) -> tuple[str, ...]:
    """Return the differences that make two robots different machines, in words."""
    pairs: tuple[tuple[str, Array | None, Array | None], ...] = (
        ("joints of the base", one.base_joints, other.base_joints),
        ("joints of the platform", one.platform_joints, other.platform_joints),
        ("first cardan axes", one.alpha_axes, other.alpha_axes),
        ("gravity", one.gravity, other.gravity),
        ("noise of the forces", _force_covariance(one), _force_covariance(other)),
    )
    found = [words for words, first, second in pairs if not _same(first, second)]
    if _force_spectrum(one) != _force_spectrum(other):
        found.append("spectrum of the force noise")
    if one.terms != other.terms:
        found.append("terms of the model")
    return tuple(found)


def machines(robots: Sequence[ResolvedRobot]) -> tuple[int, ...]:
    """Return the machine of every robot: the position of the first that is the same."""
    found: list[int] = []
    for position, robot in enumerate(robots):
        earlier = (k for k in sorted(set(found)) if not differing(robots[k], robot))
        found.append(next(earlier, position))
    return tuple(found)


def _force_covariance(robot: ResolvedRobot) -> Array | None:
    return None if robot.noise is None else robot.noise.force_covariance


def _force_spectrum(robot: ResolvedRobot) -> ForceSpectrum | None:
    """Return how the noise of the forces is spread over the frequencies; None: white."""
    if robot.noise is None or robot.noise.force_spectrum is None:
        return None
    noise = robot.description.noise
    return None if noise is None else noise.force_spectrum


def _same(first: Array | None, second: Array | None) -> bool:
    if first is None or second is None:
        return first is second
    largest = float(np.max(np.abs(first)))
    return bool(np.allclose(first, second, rtol=0, atol=_SAME * largest))
