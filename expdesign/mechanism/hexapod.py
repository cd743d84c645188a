"""Actuators and coordinates of a hexapod: their number and names."""

from __future__ import annotations

from dataclasses import dataclass

ACTUATORS = 6
"""Struts, and with them actuators, lengths and forces."""


@dataclass(frozen=True)
class Coordinate:
    """One coordinate of the pose λ: its name in files and messages, SI unit, meaning."""

    name: str
    unit: str
    meaning: str


POSE = (
    Coordinate("x", "m", "TCP position x, base frame"),
    Coordinate("y", "m", "TCP position y, base frame"),
    Coordinate("z", "m", "TCP position z, base frame"),
    Coordinate("phi", "rad", "rotation φ about x"),
    Coordinate("theta", "rad", "rotation θ about the moved y"),
    Coordinate("psi", "rad", "rotation ψ about the moved z"),
)
"""λ = (x, y, z, φ, θ, ψ): position of the TCP and rotation of the platform."""

COORDINATES = len(POSE)

COORDINATE_NAMES = tuple(coordinate.name for coordinate in POSE)


def actuator_names(prefix: str, suffix: str = "") -> tuple[str, ...]:
    """Return one name per actuator, counted from 1: ``q1`` … ``q6``."""
    return tuple(f"{prefix}{number}{suffix}" for number in range(1, ACTUATORS + 1))
