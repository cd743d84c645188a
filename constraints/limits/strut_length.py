"""Stroke: length of every strut."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="strut_length",
    title="strut length",
    unit="m",
    kind="interval",
    per_actuator=True,
    requires=("strut_length",),
    natural=lambda q: q["strut_length"],
)
