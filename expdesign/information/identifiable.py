"""Base parameters: the combinations of parameters that forces determine.

Rows of W are whitened rows of A, so that WᵀW = F. A null vector of W is a change of the parameters
without effect on any force: the rank of W is the number b of base parameters. QR with column
pivoting of the null space's transpose selects the d = m − b regrouped parameters: they have its
largest components, so that the other columns are as independent as possible. With W_d = W_b C the
forces are those of

    β = p_b + C p_d,

for every p_d: base parameters by regrouping (Gautier and Khalil, IEEE Trans. Robotics and
Automation 6, 1990; Gautier, J. Robotic Systems 8, 1991). The same applies to directions hidden by
noise instead of the null space: with C = F_bb⁻¹ F_bd the covariance of β is F_bb⁻¹, that of p_b
with known p_d, however uncertain p_d is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.mechanism.terms import parameter_unit
from expdesign.runfolder import OpenNumber, described

DEPENDENT = 1e-6
"""Smallest nonzero singular value of W with unit columns, relative to the largest: below it the
square, an eigenvalue of F, is a rounding error."""
IDENTIFIABLE = 0.5
"""A parameter counts as identified below this standard deviation, as a share of its scale."""
SHARE = 0.1
"""Smallest squared component, relative to the largest, of a parameter in a direction."""
_NEGLIGIBLE = 1e-8
"""Coefficients between unit columns below it are rounding errors."""
_EARLIER = 1e-9
"""Preference for later parameters as regrouped ones among equal components."""
_DIGITS = 4


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Determined combinations β = T p of the m parameters, SI."""

    names: tuple[str, ...]
    """(m,) of the parameters."""
    base: tuple[str, ...]
    """(b,) one parameter of each combination, with the coefficient one; it is in no other."""
    matrix: Array
    """(b, m), T: a combination has the unit of its parameter."""
    units: Array
    """(m,) inverse lengths of the columns of W: units in which components are compared."""

    @classmethod
    def of(
        cls,
        root: Array,
        names: Sequence[str],
        scales: Array | None = None,
        keep: Array | None = None,
    ) -> BaseParameters:
        """Return the base parameters of W, (r, m).

        Parameters
        ----------
        root : (r, m)
            W, or another matrix with WᵀW = F.
        scales : (m,), optional
            Sizes of the parameters. A direction of one size is determined if its standard deviation
            is below one. By default the columns have unit length, and the threshold is
            `DEPENDENT`.
        keep : (m,), optional
            Weights: of two candidates the one with the smaller weight is regrouped.

        Examples
        --------
        >>> BaseParameters.of(np.ones((2, 2)), ("r1", "s1")).text("r1")
        'r1 + s1'
        """
        norms = np.linalg.norm(root, axis=0)
        units: Array = 1 / np.asarray(np.where(norms > 0, norms, 1.0))
        # Columns of unit length are well conditioned, whatever the threshold.
        unit = np.asarray(np.linalg.qr(root * units, mode="r"), dtype=np.float64)
        ratios = np.ones(norms.shape) if scales is None else scales / units
        chosen, left = _split_columns(unit * ratios, relative=scales is None, keep=keep)
        coefficients: Array = np.zeros((len(chosen), len(left)))
        if len(chosen) and len(left):
            solved = np.linalg.lstsq(unit[:, chosen], unit[:, left], rcond=None)[0]
            coefficients = np.where(np.abs(solved) < _NEGLIGIBLE, 0.0, solved)
        matrix = np.zeros((len(chosen), len(names)))
        matrix[np.arange(len(chosen)), chosen] = 1.0
        matrix[:, left] = coefficients * np.divide.outer(units[chosen], units[left])
        return cls(tuple(names), tuple(names[k] for k in chosen), matrix, units)

    @classmethod
    def each(cls, names: Sequence[str]) -> BaseParameters:
        """Return the parameters themselves as base parameters."""
        count = len(names)
        return cls(tuple(names), tuple(names), np.eye(count), np.ones(count))

    @property
    def regrouped(self) -> tuple[str, ...]:
        """Names of the parameters that appear in combinations only, or in none."""
        return tuple(name for name in self.names if name not in self.base)

    def values(self, parameters: Array) -> Array:
        """Return β, (b,), of parameters (m,)."""
        return self.matrix @ parameters

    def regrouping(self, names: Sequence[str]) -> Array:
        """Return the matrix, (m, m), from p to β for base parameters, to 0 for regrouped ones.

        `names` are those of the m parameters; the others of them stay.
        """
        at = [names.index(name) for name in self.names]
        own = [names.index(name) for name in self.base]
        found = np.eye(len(names))
        found[at] = 0.0
        found[np.ix_(own, at)] = self.matrix
        return found

    def into(self, name: str) -> tuple[str, ...]:
        """Return the base parameters into which a parameter regroups."""
        column = self.matrix[:, self.names.index(name)]
        return tuple(self.base[k] for k in np.flatnonzero(column) if self.base[k] != name)

    def members(self, base: str) -> dict[str, float]:
        """Return the parameters regrouped into a base parameter, with their coefficients."""
        row = self.matrix[self.base.index(base)]
        return {
            name: float(c) for name, c in zip(self.names, row, strict=True) if c and name != base
        }

    def partners(self, name: str) -> tuple[str, ...]:
        """Return the base parameters with which a regrouped one is mostly confounded."""
        k = self.names.index(name)
        at = [self.names.index(base) for base in self.base]
        parts = (self.matrix[:, k] * self.units[k] / self.units[at]) ** 2
        largest = float(np.max(parts, initial=0.0))
        return tuple(self.base[i] for i in np.flatnonzero(parts > SHARE * largest))

    def text(self, base: str) -> str:
        """Return a combination in words: ``"p5 + 0.98 p4"``."""
        return combination_text(base, self.members(base))

    @property
    def combined(self) -> tuple[str, ...]:
        """Base parameters with regrouped ones."""
        return tuple(base for base in self.base if self.members(base))

    def sentences(self) -> Iterator[str]:
        """Yield a sentence for each regrouped parameter."""
        for name in self.regrouped:
            into = self.into(name)
            if not into:
                yield f"nothing shows {name}"
                continue
            texts = [self.text(base) for base in self.partners(name)]
            more = len(into) - len(texts)
            also = f", and in {more} further combination{'' if more == 1 else 's'}" if more else ""
            yield f"{name} shows only in {listed(texts)}{also}"

    def after(self, first: BaseParameters) -> BaseParameters:
        """Return combinations of the base parameters of `first` in terms of its parameters."""
        return BaseParameters(first.names, self.base, self.matrix @ first.matrix, first.units)


def combination_text(base: str, members: Mapping[str, float]) -> str:
    """Return p_b + Σ c p in words.

    Examples
    --------
    >>> combination_text("p5", {"p4": 0.98, "p7": -1.0})
    'p5 + 0.98 p4 − p7'
    """
    text = base
    for name, coefficient in members.items():
        size = f"{abs(coefficient):.{_DIGITS}g}"
        text += f" {'+' if coefficient > 0 else '−'} {'' if size == '1' else f'{size} '}{name}"
    return text


def listed(texts: Sequence[str]) -> str:
    """Return texts as a list in a sentence.

    Examples
    --------
    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def root_of(information: Array) -> Array:
    """Return W, (m, m), with WᵀW = F, computed with scaled columns to retain accuracy."""
    scales = np.sqrt(np.maximum(np.diag(information), 0.0))
    divisor = np.where(scales > 0, scales, 1.0)
    values, vectors = np.linalg.eigh(information / np.multiply.outer(divisor, divisor))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scales


def root_of_inverse(covariance: Array) -> Array:
    """Return W, (m, m), with WᵀW the inverse of a covariance, (m, m)."""
    std = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.multiply.outer(std, std))
    floor = np.finfo(float).eps * values[-1]
    return (vectors / np.sqrt(np.maximum(values, floor))).T / std


def _split_columns(
    columns: Array, *, relative: bool, keep: Array | None
) -> tuple[list[int], list[int]]:
    """Return the base columns and the regrouped ones of scaled columns, (r, m), ascending."""
    count = columns.shape[1]
    weights = np.ones(count) if keep is None else 1 / np.asarray(keep)
    weights = weights * (1 + _EARLIER * np.arange(count))
    chosen, left = list(range(count)), list[int]()
    while chosen:
        _, values, vectors = np.linalg.svd(columns[:, chosen])
        values = np.append(values, np.zeros(len(chosen) - len(values)))
        least = DEPENDENT * values[0] if relative else 1.0
        hidden = int(np.count_nonzero(values <= least))
        if not hidden:
            break
        null = vectors[-hidden:] * weights[chosen]
        pivots = sla.qr(null, mode="r", pivoting=True)[1][:hidden]
        out = {chosen[k] for k in pivots}
        left += out
        chosen = [k for k in chosen if k not in out]
        if not relative:
            break
        # The rest has full rank, except for rounding errors at the threshold itself.
    return chosen, sorted(left)


_TOGETHER = 0.9
"""Ratio of standard deviations, combination to parameter, from which on the other parameters in a
combination hardly matter."""


@dataclass(frozen=True)
class KnownCombination:
    """An identified combination of parameters."""

    combination: Annotated[str, described("", "sum of parameters, such as p5 + 0.98 p4")]
    parameter: Annotated[str, described("", "the one that has the coefficient one, its base")]
    unit: Annotated[str, described("", "SI unit of that parameter, of value and std")]
    value: Annotated[OpenNumber, described("see unit", "of the combination")]
    std: Annotated[OpenNumber, described("see unit", "standard deviation of the combination")]
    std_alone: Annotated[
        OpenNumber,
        described(
            "see unit", "of that parameter alone; empty if no motion distinguishes it from others"
        ),
    ]
    rel_std_percent: Annotated[
        OpenNumber, described("%", "std over the scale of the parameter that is its base")
    ]
    regrouped: Annotated[str, described("", "the other parameters in it; empty: none")]
    identified: Annotated[bool, described("", "std below half of that scale")]

    @property
    def together(self) -> bool:
        """Whether it is clearly better determined than its base parameter alone."""
        return bool(self.regrouped) and not self.std > _TOGETHER * self.std_alone


def identified_base(root: Array, names: tuple[str, ...], scales: Array) -> BaseParameters:
    """Return the base parameters that an experiment identifies.

    Parameters
    ----------
    root : (r, m)
        W with WᵀW the information of the whole experiment, SI.
    names : (m,) of str
    scales : (m,)
        Scale of each parameter, SI.
    """
    return BaseParameters.of(root, names, scales=IDENTIFIABLE * scales)


def known_combinations(
    base: BaseParameters,
    structure: BaseParameters,
    names: Sequence[str],
    values: Array,
    covariance: Array,
    scales: Array,
) -> tuple[KnownCombination, ...]:
    """Return value and standard deviation of combinations.

    Parameters
    ----------
    base : BaseParameters
        The identified ones of the base parameters of `structure`.
    structure : BaseParameters
    names, values, covariance, scales : (m,), (m,), (m, m), (m,)
        Of all parameters, SI; zero covariance of those that regroup in the structure.
    """
    base, at = base.after(structure), [names.index(name) for name in structure.names]
    alone, own = np.sqrt(np.diag(covariance)), covariance[np.ix_(at, at)]
    found = base.values(values[at])
    spread = np.sqrt(np.maximum(np.diag(base.matrix @ own @ base.matrix.T), 0.0))
    rows = []
    for name, value, std in zip(base.base, found.tolist(), spread.tolist(), strict=True):
        place = names.index(name)
        share = std / float(scales[place])
        inseparable = name in structure.combined
        rows.append(
            KnownCombination(
                combination=base.text(name),
                parameter=name,
                unit=parameter_unit(name),
                value=value,
                std=std,
                std_alone=np.nan if inseparable else float(alone[place]),
                rel_std_percent=100 * share,
                regrouped=", ".join(base.members(name)),
                identified=bool(share < IDENTIFIABLE),
            )
        )
    return tuple(rows)
