"""The `study` section of a run, and runs that differ from it in one respect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from expdesign.configuration import RunConfiguration, StudySection

_NOISELESS = 1e-6
"""Length noise of exact kinematics, as a share of the robot's: an estimate needs some."""


class TooFewEstimatesError(ArithmeticError):
    """Noise let so many estimates fail that nothing can be compared."""


def study_section(configuration: RunConfiguration) -> StudySection:
    """Return the run's `study`; a run without one has none to do."""
    section = configuration.run.study
    if section is None:
        raise ValueError("the run has no study")
    return section


def with_section(configuration: RunConfiguration, name: str, **changes: Any) -> RunConfiguration:
    """Return the run with keys of one of its sections changed."""
    section = getattr(configuration.run, name).model_copy(update=changes)
    return replace(configuration, run=configuration.run.model_copy(update={name: section}))


def with_exact_lengths(configuration: RunConfiguration) -> RunConfiguration:
    """Return the run with lengths that are measured a million times better."""
    noise = configuration.robot.noise
    if noise is None or noise.length_covariance is None:
        return configuration
    quiet = replace(noise, length_covariance=noise.length_covariance * _NOISELESS**2)
    return replace(configuration, robot=replace(configuration.robot, noise=quiet))
