"""One assumption and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from expdesign.runfolder import described


class Outcome(StrEnum):
    """What became of an assumption."""

    HOLDS = "holds"
    FAILS = "fails"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Finding:
    """One assumption."""

    assumption: Annotated[str, described("", "in words")]
    outcome: Annotated[Outcome, described("", "holds, fails or not tested")]
    sentence: Annotated[str, described("", "what was seen")]
    advice: Annotated[str, described("", "what to do next; empty when the assumption holds")] = ""
    serious: Annotated[
        bool, described("", "its failure makes parameters or intervals doubtful")
    ] = True
