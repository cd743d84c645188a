"""Acceleration of every strut."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="strut_acceleration",
    title="strut acceleration",
    unit="m/s^2",
    kind="symmetric",
    per_actuator=True,
    requires=("strut_acceleration",),
    natural=lambda q: q["strut_acceleration"],
)
