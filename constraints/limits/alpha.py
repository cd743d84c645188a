"""First cardan angle of every strut."""

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="alpha",
    title="cardan angle α",
    unit="rad",
    kind="interval",
    per_actuator=True,
    requires=("alpha",),
    natural=lambda q: q["alpha"],
)
