"""How large what a run asks for becomes: refused before anything of it is computed.

Every size has a bound of its own, so that nothing that is computed at once takes more than some
four gigabytes. The bytes are what was measured, rounded up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from expdesign.configuration.document import Document
from expdesign.configuration.errors import Key, Problem
from expdesign.configuration.run import RunDescription
from expdesign.mechanism.hexapod import COORDINATES

MEMORY = 4 * 10**9
"""Bytes that what is computed at once may take."""

DISK = 50 * 10**9
"""Bytes that one command may write."""

_LONGEST_SEGMENT = 0.1
"""s; no table chooses longer ones."""


class Excess(NamedTuple):
    """Why something is too large, and what would not be."""

    message: str
    allowed: str


@dataclass(frozen=True)
class Size:
    """Something that there can be many of: `each` takes so many bytes, of `within` in all."""

    what: str
    each: float
    within: float = MEMORY
    medium: str = "memory"

    @property
    def most(self) -> int:
        """How many there may be, to two digits."""
        found = self.within / self.each
        unit = 10 ** max(0, math.floor(math.log10(found)) - 1)
        return int(found // unit * unit)

    def excess(self, count: float, made: str = "") -> Excess | None:
        """Return what is wrong with a number of them, None where it is within the bound.

        `made` tells what they come from, where they are not given as such: ``10 periods of 10 s at
        1000 Hz``.
        """
        if count <= self.most:
            return None
        needs = f"{_bytes(count * self.each)} of {self.medium}"
        many = f"{_count(count)} {self.what}"
        return Excess(
            f"{made}: {many}, which take {needs}" if made else f"{many} take {needs}",
            f"at most {_count(self.most)} {self.what}",
        )

    def factors(self, count: int, each: float, made: str = "") -> Excess | None:
        """Return the same of a number of what holds `each` of them, with how many of it fit."""
        if (found := self.excess(count * each, made)) is None:
            return None
        fit = int(self.most / each)
        fit -= fit * each > self.most  # the quotient was rounded up
        return Excess(found.message, f"at most {_count(fit)}, for {found.allowed}")


def _count(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ") if value < 1e15 else f"{value:.3g}"  # noqa: PLR2004


def _bytes(value: float) -> str:
    for unit, size in (("TB", 1e12), ("GB", 1e9)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e6:.3g} MB"


SAMPLES = Size("samples of one recording", 1000)
"""Simulated, read and estimated from; spectra and all channels included."""

PERIOD_ROWS = Size("controller steps in one period", 4000)
"""Rows of trajectory.csv and of what is drawn of it."""

TABLE_ROWS = Size("rows of one table", 4000)
"""Of a controller table: written, read back and executed."""

MEASURED_ROWS = Size("rows of measurements", 250, DISK, "disk")
"""Of all repetitions of an experiment, as text."""

REPETITIONS = Size("repetitions", 10_000)
"""Of a Monte-Carlo study: estimates and standard deviations of three estimators."""


def design_samples(harmonics: int) -> Size:
    """Return the size of the samples of a design with so many harmonics.

    Each has rows of limits in the problem, with a derivative to every variable.
    """
    variables = 2 * COORDINATES * harmonics + COORDINATES + 1
    return Size(f"samples with {harmonics} harmonics", 50_000 + 2200 * variables)


def oversized(run: RunDescription, document: Document) -> Iterator[Problem]:
    """Yield what a run asks for that would be too large, whatever is designed.

    A motion between the bounds of the frequency is taken as it is the shortest; but the rows of
    one period, which every design writes, are those of the longest.
    """

    def problem(key: Key, excess: Excess | None) -> Iterator[Problem]:
        if excess is not None:
            yield document.problem(key, *excess)

    longest, shortest = (1 / frequency for frequency in run.trajectory.frequency)
    harmonics, samples = run.trajectory.harmonics, run.trajectory.samples
    found = design_samples(harmonics).excess(samples)
    yield from problem(("trajectory", "samples"), found)

    step = run.controller_period
    of_step: Key = ("trajectory", "controller_period")
    if run.trajectory.controller_period is None:
        of_step = ("experiment", "sampling")
    found = PERIOD_ROWS.excess(longest / step, f"steps of {step:g} s in up to {longest:g} s")
    yield from problem(of_step, found)

    periods, sampling = run.experiment.periods, run.experiment.sampling
    made = f"{periods} periods of {shortest:g} s or more at {sampling:g} Hz"
    of_period = shortest * sampling
    if of_period <= SAMPLES.most:
        yield from problem(("experiment", "periods"), SAMPLES.factors(periods, of_period, made))
    else:
        found = SAMPLES.excess(periods * of_period, made)
        yield from problem(("experiment", "sampling"), found)

    for number, section in enumerate(run.export):
        # Without a segment of its own a table has the controller's steps, or chooses them.
        rows = section.segment or max(step, _LONGEST_SEGMENT)
        key = "segment" if section.segment else "format"
        made = f"{periods} periods of {shortest:g} s or more in steps of {rows:g} s"
        if section.factor != 1:
            made += f", scaled by {section.factor:g}"
        found = TABLE_ROWS.excess(periods * shortest / section.factor / rows, made)
        yield from problem(("export", number, key), found)

    found = REPETITIONS.excess(run.montecarlo.repetitions)
    yield from problem(("montecarlo", "repetitions"), found)
