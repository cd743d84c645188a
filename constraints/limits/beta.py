"""Second cardan angle of every strut."""

import numpy as np

from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="beta",
    title="cardan angle β",
    unit="rad",
    kind="interval",
    per_actuator=True,
    requires=("beta", "sin_beta"),
    natural=lambda q: q["beta"],
    smooth=lambda q: q["sin_beta"],
    transform=np.sin,
)
