"""What a study was to show, and what it showed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Claim:
    """One statement.

    Attributes
    ----------
    statement : str
    value : str
        What was found, on the digital twin.
    paper : str
        The paper's value; empty where it states none.
    holds : bool or None
        None where nothing is claimed.
    """

    statement: str
    value: str
    paper: str = ""
    holds: bool | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)
