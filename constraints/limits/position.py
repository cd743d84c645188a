"""Workspace of the tool centre point."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="position",
    title="TCP position",
    unit="m",
    kind="interval",
    components=("x", "y", "z"),
    requires=("position",),
    natural=lambda q: q["position"],
)
