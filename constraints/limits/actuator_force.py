"""Force of every actuator at the nominal parameters."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="actuator_force",
    title="actuator force",
    unit="N",
    kind="symmetric",
    per_actuator=True,
    requires=("actuator_force",),
    natural=lambda q: q["actuator_force"],
)
