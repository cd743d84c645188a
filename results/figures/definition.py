"""What a figure is: a name, what it shows, and how it is drawn from a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from matplotlib.figure import Figure

Record = TypeVar("Record", contravariant=True)  # noqa: PLC0105 - the word is the reader's


@dataclass(frozen=True)
class FigureDefinition(Generic[Record]):
    """A figure of a kind of record: name of its files without the ending, caption for reports.

    `draw` computes nothing but what is shown, and saves nothing.
    """

    key: str
    caption: str
    draw: Callable[[Record], Figure]
