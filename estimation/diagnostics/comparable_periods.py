"""Whether the periods of a record are compared sample by sample, and why not.

Only contrasts between periods hold noise and no signal whatever the model is: the tests of memory,
of change from period to period and of a hum are made from them.
"""

from __future__ import annotations

from estimation.processing import Record

_FEWEST = 2


def why_not_compared(record: Record) -> str:
    """Return why no two periods are compared sample by sample; empty where they are."""
    if record.averaged and record.forces.periods is not None:
        few = len(record.forces.periods) < _FEWEST
        return "there is one period, and nothing to compare it with" if few else ""
    if record.lost:
        missing = "1 sample is" if record.lost == 1 else f"{record.lost} samples are"
        return (
            f"{missing} missing in the recording, and periods are compared sample by sample only "
            "where none is"
        )
    if record.stamped:
        return "stamped samples keep their own times, and no two periods have the same"
    return (
        "samples keep their own times where the frequency is estimated or a period is no whole "
        f"number of them ({record.period / record.step:.6g}), and no two periods have the same"
    )
