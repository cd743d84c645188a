"""What can be known: which parameters the forces tell, and which only together with others.

Rows of W are whitened rows of A, so that WᵀW = F. A null vector of W is a change of the parameters
that no force shows: the rank of W is the number b of base parameters. QR with column pivoting of
the null space's transpose takes the d = m − b parameters that are left out: they have the largest
parts of it, so that the other columns are independent, and as far from dependent as any. With
W_d = W_b C the forces are those of

    β = p_b + C p_d,

whatever p_d is: base parameters by regrouping (Gautier and Khalil, IEEE Trans. Robotics and
Automation 6, 1990; Gautier, J. Robotic Systems 8, 1991). The same with directions that noise hides
in place of the null space: C = F_bb⁻¹ F_bd is then what makes the covariance of β that of p_b with
p_d known, F_bb⁻¹, however badly p_d is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array

DEPENDENT = 1e-6
"""Smallest singular value of W with unit columns, relative to the largest, that is one: the square,
an eigenvalue of F, is rounding below it."""

IDENTIFIABLE = 0.5
"""A parameter counts as identified below this standard deviation, as a share of its scale."""

SHARE = 0.1
"""From this share (of the largest squared part) on, a parameter takes part in a direction."""

_NEGLIGIBLE = 1e-8
"""Coefficients between unit columns below it are rounding."""
_EARLIER = 1e-9
"""By how much less an earlier parameter is preferred among those with equal parts."""
_DIGITS = 4


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Combinations β = T p of the m parameters that the forces tell, SI."""

    names: tuple[str, ...]
    """(m,) of the parameters."""
    base: tuple[str, ...]
    """(b,) a parameter for each combination, which has the coefficient one in it and is in no
    other."""
    matrix: Array
    """(b, m), T: a combination has the unit of its parameter."""
    units: Array
    """(m,) what makes a column of W one of unit length, by which parts are compared."""

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
            W, or any other matrix with WᵀW = F.
        scales : (m,), optional
            Sizes of the parameters, in which a direction counts when W moves it by more than one:
            its standard deviation is then below its size. By default the columns have unit length,
            and a direction counts from `DEPENDENT` on.
        keep : (m,), optional
            Weights: of two parameters that may be left out the one with the smaller weight is.
        """
        norms = np.linalg.norm(root, axis=0)
        units: Array = 1 / np.asarray(np.where(norms > 0, norms, 1.0))
        # The columns of unit length keep the digits, whatever decides.
        unit = np.asarray(np.linalg.qr(root * units, mode="r"), dtype=np.float64)
        ratios = np.ones(norms.shape) if scales is None else scales / units
        chosen, left = _regrouped(unit * ratios, relative=scales is None, keep=keep)
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
        """Return the parameters themselves, each for itself."""
        count = len(names)
        return cls(tuple(names), tuple(names), np.eye(count), np.ones(count))

    @property
    def regrouped(self) -> tuple[str, ...]:
        """Names of the parameters that are in combinations only, or in none."""
        return tuple(name for name in self.names if name not in self.base)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that no force shows at all."""
        seen = np.any(self.matrix != 0, axis=0)
        return tuple(name for name, there in zip(self.names, seen, strict=True) if not there)

    def values(self, parameters: Array) -> Array:
        """Return β, (b,), of parameters (m,)."""
        return self.matrix @ parameters

    def into(self, name: str) -> tuple[str, ...]:
        """Return the base parameters that a parameter regroups into."""
        column = self.matrix[:, self.names.index(name)]
        return tuple(self.base[k] for k in np.flatnonzero(column) if self.base[k] != name)

    def members(self, base: str) -> dict[str, float]:
        """Return the parameters that regroup into a base parameter, with their coefficients."""
        row = self.matrix[self.base.index(base)]
        return {
            name: float(c) for name, c in zip(self.names, row, strict=True) if c and name != base
        }

    def partners(self, name: str) -> tuple[str, ...]:
        """Return the base parameters that a regrouped one is mostly confounded with."""
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
        """Base parameters that others regroup into."""
        return tuple(base for base in self.base if self.members(base))

    def sentences(self) -> Iterator[str]:
        """Yield in words what regroups into what, a sentence for each parameter that is left."""
        for name in self.regrouped:
            into = self.into(name)
            if not into:
                yield f"nothing shows {name}"
                continue
            told = [self.text(base) for base in self.partners(name)]
            more = len(into) - len(told)
            also = f", and in {more} further combination{'' if more == 1 else 's'}" if more else ""
            yield f"{name} shows only in {listed(told)}{also}"

    def after(self, first: BaseParameters) -> BaseParameters:
        """Return the combinations of the base parameters of `first` as those of its parameters."""
        return BaseParameters(first.names, self.base, self.matrix @ first.matrix, first.units)


def combination_text(base: str, members: Mapping[str, float]) -> str:
    """Return p_b + Σ c p in words."""
    text = base
    for name, coefficient in members.items():
        size = f"{abs(coefficient):.{_DIGITS}g}"
        text += f" {'+' if coefficient > 0 else '−'} {'' if size == '1' else f'{size} '}{name}"
    return text


def listed(texts: Sequence[str]) -> str:
    """Return texts as a list in a sentence: ``"a, b and c"``."""
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def root_of(information: Array) -> Array:
    """Return W, (m, m), with WᵀW = F, the columns' scales taken out so that no digits are lost."""
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


def _regrouped(
    columns: Array, *, relative: bool, keep: Array | None
) -> tuple[list[int], list[int]]:
    """Return which columns, (r, m) scaled, are base and which are left out, ascending."""
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
        # What is left has the rank, but at the threshold itself rounding may ask for another one.
    return chosen, sorted(left)
