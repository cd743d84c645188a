"""A hum that is a multiple of the motion's frequency, as a cause of residuals.

It is the same in every period: contrasts do not hold it, and the mean over the periods keeps it.
In the mean residuals it is one line, at the multiple of the base frequency that it is next to.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimation.diagnostics.cause import Cause
from estimation.diagnostics.channel_test import CAUSES
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.signature import Signature
from estimation.diagnostics.suspects import Suspects
from estimation.processing.hum import mains_frequencies
from estimation.processing.record import Record
from expdesign.mechanism.hexapod import ACTUATORS

_FEWEST_PERIODS = 2
_MULTIPLES = 3
"""Of the mains: a hum that shows in others alone is none."""


def hidden_hums(record: Record) -> tuple[tuple[float, int], ...]:
    """Return frequencies of the mains, Hz, within a line of the record from a multiple; and that.

    Below half of the sampling. Of a single period every frequency is: none is returned.
    """
    if record.periods < _FEWEST_PERIODS:
        return ()
    base = 1 / record.period
    found = []
    for frequency in mains_frequencies(1 / record.step, _MULTIPLES):
        multiple = round(frequency / base)
        if multiple and abs(frequency - multiple * base) < base / record.periods:
            found.append((frequency, multiple))
    return tuple(found)


def hum_causes(suspects: Suspects) -> Iterator[Cause]:
    """Yield the family of hums that no contrast sees; nothing where there are none."""
    part, record = suspects.part, suspects.experiment.record
    hidden = hidden_hums(record)
    if not hidden:
        return
    columns = []
    for _, multiple in hidden:
        angle = multiple * record.omega * record.forces.times
        pair = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        each = np.einsum("tp,ij->tijp", pair, np.eye(ACTUATORS))
        columns.append(part.cells.mean(each.reshape(len(angle), ACTUATORS, -1)))
    width = 2 * ACTUATORS
    yield Cause(
        kind="hum",
        labels=tuple((f"of {frequency:g} Hz", None) for frequency, _ in hidden),
        columns=Signature.of_forces(part, np.concatenate(columns, axis=2)),
        places=tuple(tuple(range(k * width, (k + 1) * width)) for k in range(len(hidden))),
        level=CAUSES,
        assumption=Assumption(
            "no hum that repeats in every period",
            "the mains hum at a multiple of the motion's frequency",
            "earth and shield the measurement, or state the frequency in "
            "`noise.force_spectrum.hum` of the run and design again: the motion then keeps away "
            "from it",
        ),
        noun="a hum",
        absent="no hum of the mains at a multiple of the motion's frequency (p = {p:.2g})",
        untested="the model's own columns leave nothing of it",
        unit=lambda _: "N",
        paired=True,
    )
