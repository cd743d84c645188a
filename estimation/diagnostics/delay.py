"""The delay between the channels of lengths and forces that fits best: one Gauss–Newton step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_serializer

from estimation.diagnostics.column_test import Cause, ColumnTest
from estimation.diagnostics.levels import DELAY
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class DelayTest:
    """By how much the forces lag behind the lengths, beyond the delays that were given."""

    refused: Annotated[str, described("", "why there is no test; empty when there is one")]
    delay: Annotated[
        OpenNumber, Field(alias="seconds"), described("s", "positive when the forces lag")
    ] = np.nan
    std: Annotated[OpenNumber, described("s", "standard deviation of the delay")] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the two-sided test of no delay")
    ] = np.nan
    level: Annotated[float, Field(exclude=True), described("1", "of the test")] = DELAY

    @property
    def failed(self) -> bool:
        """Tell whether there is a delay."""
        return bool(np.isfinite(self.log_p) and self.log_p < np.log(self.level))

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return (
            {"refused": self.refused} if self.refused else {**fields(self), "failed": self.failed}
        )


def delay_test(test: ColumnTest, cause: Cause) -> DelayTest:
    """Take the test of its column, in which dry friction, without a derivative, has no part."""
    if not test.tested:
        return DelayTest(cause.untested, level=cause.level)
    delay, std, log_p = (float(values[0]) for values in (test.coefficients, test.std, test.log_p))
    return DelayTest("", delay, std, log_p, cause.level)
