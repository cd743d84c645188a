"""Whether all bodies are wrong by one factor: forces of another unit, or of the other sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.finding import listed
from expdesign.configuration.values.quantity import FORCE

_FAR = 9.0
"""Factor from which it is no other machine of the kind; kilograms in place of newtons make 9.8."""
_NEAR = 0.15
"""How well a factor must be that of a unit: masses are known that well."""
_LARGE = 2.5
_KNOWN_WELL = 0.1
_ALIKE = 0.3
_MOST = 2 / 3
_FEWEST = 2


@dataclass(frozen=True, eq=False)
class ForceScale:
    """The factor between estimated parameters of bodies and those expected."""

    factor: float
    alike: NDArray[np.bool_]
    """(m,), the parameters that differ by it."""
    p: float
    """That noise makes the difference in the least certain of these."""

    @classmethod
    def of(
        cls, values: Array, std: Array, expected: Array, judged: NDArray[np.bool_]
    ) -> Self | None:
        """Return the factor of most parameters that are known well, (m,) each; None without one.

        `judged` are the parameters of bodies that were estimated. A factor counts when it is
        negative, nine or more, a ninth or less, or that between newtons and another unit.
        """
        known = judged & (expected != 0) & (std < _KNOWN_WELL * np.abs(values))
        if np.count_nonzero(known) < _FEWEST:
            return None
        ratios = np.divide(values, expected, out=np.full(len(values), np.nan), where=known)
        factor = float(np.nanmedian(ratios))
        alike = known & (np.abs(ratios - factor) <= _ALIKE * abs(factor))
        if np.count_nonzero(alike) < max(_FEWEST, _MOST * np.count_nonzero(known)):
            return None
        size = abs(factor)
        far = size <= 1 / _FAR or size >= _FAR
        if factor > 0 and not far and _unit_of(size) is None:
            return None
        gaps = np.abs(values - expected)[alike] / std[alike]
        return cls(factor, alike, float(scipy.stats.norm.sf(np.min(gaps))))

    def where(self, names: tuple[str, ...]) -> str:
        """Return the parameters in words."""
        return listed([name for name, one in zip(names, self.alike, strict=True) if one])

    @property
    def sentence(self) -> str:
        """What was seen."""
        return f"the bodies' parameters are about {self.factor:.2g} times what was expected"

    @property
    def advice(self) -> str:
        """What makes that, and what to write."""
        size, words = abs(self.factor), []
        if self.factor < 0:
            words.append(
                "the sign of all forces is wrong (forces are positive when they extend the strut: "
                "`data.sign: {Q: -1}`, or a negative `data.force_constants`), or gravity and the z "
                "axis point the other way"
            )
        unit = _unit_of(size)
        if unit is not None:
            words.append(
                f"the forces are in another unit, by the factor in {unit} (`data.units: {{Q: "
                f"{unit}}}`)"
                if unit != FORCE.unit
                else "the forces are in newtons, and `data.units` says another unit"
            )
        if size <= 1 / _FAR:
            words.append(
                "currents were taken for newtons (`data.units: {Q: A}` with `data.force_constants` "
                f"of about {float(f'{1 / size:.2g}'):g} N/A), or the force constants that are "
                "given are too small by that factor"
            )
        elif size >= _FAR and unit is None:
            words.append(
                "the force constants (`data.force_constants`) are too large by about that factor"
            )
        return f"{self.sentence}: {'; or '.join(words)}"


def _unit_of(factor: float) -> str | None:
    """Return the unit whose numbers were taken for newtons, by what that makes of all parameters.

    Newtons themselves: numbers in newtons were taken for those of another unit.
    """
    if 1 / _LARGE < factor < _LARGE:
        return None
    sizes = {unit: FORCE.parse(f"1 {unit}") for unit in FORCE.units}
    near = {unit: abs(np.log(factor * size)) for unit, size in sizes.items()}
    unit = min(near, key=near.__getitem__)
    if near[unit] < _NEAR:
        return unit
    swapped = min(abs(np.log(factor / size)) for size in sizes.values())
    return FORCE.unit if swapped < _NEAR else None
