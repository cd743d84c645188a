"""Configurations of a study that differ from its run in one respect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from expdesign.configuration import RunConfiguration

_NOISELESS = 1e-6
"""Length noise of exact kinematics, as a share of the robot's: an estimate needs some."""


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
