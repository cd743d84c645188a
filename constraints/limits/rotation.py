"""Rotation angles of the platform."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="rotation",
    title="rotation angle",
    unit="rad",
    kind="interval",
    components=("phi", "theta", "psi"),
    requires=("rotation_angles",),
    natural=lambda q: q["rotation_angles"],
)
