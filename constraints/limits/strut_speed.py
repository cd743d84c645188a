"""Speed of every strut."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="strut_speed",
    title="strut speed",
    unit="m/s",
    kind="symmetric",
    per_actuator=True,
    requires=("strut_speed",),
    natural=lambda q: q["strut_speed"],
)
