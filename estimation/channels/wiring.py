"""Wirings of the channels of a recording, and fits of the forces under all of them.

The forces are linear in the parameters. Least squares with all parameters free therefore has a
closed form: with A_i the regressor of strut i and Q_j the force in channel j, the sum of squares of
a signed permutation depends on the 36 products A_iᵀ Q_j alone. All 46 080 of them take
milliseconds, whatever the true parameters are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.measurement_model.motion import root_of_pseudo_inverse
from expdesign.mechanism.hexapod import ACTUATORS

DETERMINED = 1e-12
_TINY = 1e-12
_STEPS = 12
_REACHED = 1e-9
STRUTS = np.arange(ACTUATORS)
ORDERS = np.array(list(permutations(range(ACTUATORS))))
PAIRS_OF_ORDERS = np.eye(ACTUATORS)[ORDERS].reshape(len(ORDERS), -1).T
"""(36, 720), 1 where strut i is on channel j."""
_SIGNS = np.array([(1, *signs) for signs in product((1, -1), repeat=ACTUATORS - 1)])
UNITS = {1.0: "m", 1e-3: "mm", 1e-2: "cm", 0.0254: "in", 1e-6: "µm"}
"""Units of length, by their size in m."""
_USUAL = np.array([factor * unit for factor in (0.25, 0.5, 1.0, 2.0, 4.0) for unit in UNITS])
_USUAL = np.concatenate([_USUAL, 1 / _USUAL])
SPREADS = 3.0
OTHER_GAIN = 1.3
"""Ratio of two force constants that is no tolerance of one."""
_ROUND = 0.03


@dataclass(frozen=True, eq=False)
class Wiring:
    """Readings of six struts, gain · channel + offset.

    Wirings of the same numbers are equal.
    """

    channels: NDArray[np.intp]
    """(6,), measured channel of each strut, from zero."""
    gains: Array
    """(6,), signed; 1: as measured."""
    offsets: Array
    """(6,), m or N; 0: as measured."""

    @cached_property
    def _content(self) -> tuple[bytes, ...]:
        return self.channels.tobytes(), self.gains.tobytes(), self.offsets.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Wiring) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @classmethod
    def as_measured(cls) -> Wiring:
        """Return the wiring of the recording as it was read."""
        return cls(STRUTS, np.ones(ACTUATORS), np.zeros(ACTUATORS))

    def apply(self, values: Array) -> Array:
        """Return the readings of the struts, (R, 6), from the channels, (R, 6)."""
        return values[:, self.channels] * self.gains + self.offsets

    def reorder(self, order: NDArray[np.intp]) -> Wiring:
        """Return the wiring with strut i on the channel of strut order[i] so far."""
        return Wiring(self.channels[order], self.gains[order], self.offsets[order])

    def scale(self, strut: int, gain: float, fixed: float = 0.0) -> Wiring:
        """Return the wiring with one reading multiplied by a gain about a fixed reading."""
        gains, offsets = self.gains.copy(), self.offsets.copy()
        gains[strut] *= gain
        offsets[strut] = gain * offsets[strut] + (1 - gain) * fixed
        return replace(self, gains=gains, offsets=offsets)

    def shift(self, strut: int, offset: float) -> Wiring:
        """Return the wiring with another offset of one strut."""
        return replace(self, offsets=self.offsets + offset * np.eye(ACTUATORS)[strut])


@dataclass(frozen=True)
class ChannelLag:
    """Lag of one length or force behind all other channels."""

    group: str
    """q or Q."""
    strut: int
    seconds: float
    """s."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A wiring of lengths and forces, and its unexplained forces."""

    lengths: Wiring
    forces: Wiring
    delay: float
    """Delay of the forces behind the lengths, s, in addition to the stated one."""
    excess: float
    """Unexplained part of the forces beyond the noise, as a share of their energy."""
    next_best: float = np.inf
    """The same of the best other wiring that was tried."""
    low_pass: float | None = None
    """Time constant of a low pass of all forces that is a part of their lag, s; None: the lag is
    clearly a delay."""
    channel_lag: ChannelLag | None = None
    """Further lag of a single channel."""

    @classmethod
    def as_measured(cls) -> Candidate:
        """Return the channels as they were read, with nothing explained."""
        return cls(Wiring.as_measured(), Wiring.as_measured(), 0.0, 1.0)


class ForceFit:
    """Fits of the measured forces, (R, 6), by columns A, (R, 6, m), under all wirings."""

    def __init__(self, columns: Array, forces: Array, variances: Array) -> None:
        self.columns, self._forces, self._variances = columns, forces, variances
        self._rows = columns.reshape(-1, columns.shape[2])
        self.root = root_of_pseudo_inverse(self._rows.T @ self._rows, DETERMINED)
        self.energies = np.sum(forces**2, axis=0)

    def excess(self, forces: Wiring) -> float:
        """Return the unexplained share of the forces beyond the expected noise."""
        total, noise = (
            float(each[forces.channels] @ forces.gains**2)
            for each in (self.energies, self._variances)
        )
        return (total - float(np.sum(self._project(forces) ** 2)) - noise) / total

    def parameters(self, forces: Wiring) -> Array:
        """Return the fitted parameters, (m,)."""
        return np.asarray(self.root @ self._project(forces), np.float64)

    def _project(self, forces: Wiring) -> Array:
        return np.asarray((forces.apply(self._forces).ravel() @ self._rows) @ self.root)

    @cached_property
    def _by_strut(self) -> Array:
        """(6, m, R), columns of each strut."""
        return self.columns.transpose(1, 2, 0)

    @cached_property
    def _information(self) -> Array:
        """(6, m, m), of each strut."""
        return self._by_strut @ self._by_strut.transpose(0, 2, 1)

    @cached_property
    def _moments(self) -> Array:
        """(6, m, 6), columns of strut i times the force in channel j."""
        return self._by_strut @ self._forces

    @cached_property
    def _products(self) -> Array:
        """(720, 6, 6), products of the projections of two struts under every order."""
        projections = self._moments.transpose(0, 2, 1) @ self.root
        every = projections.reshape(ACTUATORS**2, -1)
        places = ACTUATORS * STRUTS + ORDERS
        return (every @ every.T)[places[:, :, None], places[:, None]]

    @cached_property
    def explained(self) -> Array:
        """(720, 32), explained sums of squares of all orders and signs, N²."""
        # One matrix product over the pairs of struts.
        pairs = (_SIGNS[:, :, None] * _SIGNS[:, None]).reshape(len(_SIGNS), -1)
        return self._products.reshape(len(ORDERS), -1) @ pairs.T

    def best(self) -> Wiring:
        """Return the order and signs that explain most; the first sign is arbitrary."""
        order, signs = np.unravel_index(int(np.argmax(self.explained)), self.explained.shape)
        return replace(Wiring.as_measured(), channels=ORDERS[order], gains=_SIGNS[signs] * 1.0)

    def next_best(self, forces: Wiring) -> float:
        """Return the unexplained share of the best other order and signs, with equal gains."""
        order = np.all(forces.channels == ORDERS, axis=1)
        signs = np.all(np.sign(forces.gains) * np.sign(forces.gains[0]) == _SIGNS, axis=1)
        others = np.where(order[:, None] & signs, -np.inf, self.explained)
        total = float(np.sum(self.energies))
        return (total - float(np.max(others)) - float(np.sum(self._variances))) / total

    def best_with_scales(self) -> tuple[Wiring, float]:
        """Return the order and gains that explain most, and the unexplained share of the next.

        The gains of an order are an eigenvector: they maximise the explained share of the scaled
        forces. Those near the median are taken as equal.
        """
        norms = np.sqrt(np.maximum(self.energies, _TINY))[ORDERS]
        shares = self._products / (norms[:, :, None] * norms[:, None])
        values, vectors = np.linalg.eigh(shares)
        best = int(np.argmax(values[:, -1]))
        gains = vectors[best, :, -1] / norms[best]
        # One of them is the usual one: a common factor would be that of the parameters.
        usual = np.sort(np.abs(gains))[ACTUATORS // 2]
        sizes = np.maximum(np.abs(gains) / usual, _TINY)
        far = np.abs(np.log(sizes)) > np.log(OTHER_GAIN)
        gains = np.sign(gains) * np.where(far, sizes, 1.0)
        others = max(float(np.max(np.delete(values[:, -1], best))), float(values[best, -2]))
        noise = float(np.sum(self._variances) / np.sum(self.energies))
        found = replace(Wiring.as_measured(), channels=ORDERS[best], gains=gains)
        return self.fit_gains(found)[0], 1 - others - noise

    def fit_gains(self, forces: Wiring) -> tuple[Wiring, Array]:
        """Return the wiring with the best gains of scaled channels, and relative errors, (6,).

        Least squares in the measured forces, of the parameters and the reciprocal gains: the noise
        of a scaled channel biases an eigenvector, and not them.
        """
        signs, reciprocal = np.sign(forces.gains), 1 / np.abs(forces.gains)
        scaled, errors = np.flatnonzero(reciprocal != 1), np.zeros(ACTUATORS)
        if not len(scaled):
            return forces, errors
        moments = signs[:, None] * self._moments[STRUTS, :, forces.channels]
        for _ in range(_STEPS):
            information = np.tensordot(reciprocal**2, self._information, axes=1)
            root = root_of_pseudo_inverse(information, DETERMINED)
            explained = root.T @ (reciprocal @ moments)
            parameters = root @ explained
            own = self._information[scaled] @ parameters
            mixed = reciprocal[scaled, None] * (own @ root)
            slope = moments[scaled] @ parameters - reciprocal[scaled] * (own @ parameters)
            inverse = np.linalg.pinv(np.diag(own @ parameters) - mixed @ mixed.T)
            step = inverse @ slope / reciprocal[scaled]
            reciprocal[scaled] *= np.exp(np.clip(step, -1, 1))
            if np.max(np.abs(step)) < _REACHED:
                break
        # Every channel has a noise of its own, in the scaled ones as many times larger.
        known = np.eye(ACTUATORS)[scaled, :, None] * parameters
        known = known - reciprocal[:, None] * (mixed @ root.T)[:, None]
        energies = np.einsum("lim,imn,kin->ilk", known, self._information, known, optimize=True)
        predicted = np.einsum("m,imn,n->i", parameters, self._information, parameters)
        rest = self.energies[forces.channels] + reciprocal**2 * predicted
        rest = rest - 2 * reciprocal * (moments @ parameters)
        variances = rest / max(len(self._forces) - len(parameters) / ACTUATORS, 1.0)
        spread = inverse @ np.tensordot(variances, energies, axes=1) @ inverse
        errors[scaled] = np.sqrt(np.abs(np.diag(spread))) / reciprocal[scaled]
        far = np.abs(np.log(reciprocal)) > np.log(OTHER_GAIN) + SPREADS * errors
        gains = signs * np.where(far, round_factor(1 / reciprocal), 1.0)
        return replace(forces, gains=gains), np.where(far, errors, 0.0)


def round_factor(factors: Array) -> Array:
    """Return the factors, those near a usual one as this one.

    Examples
    --------
    >>> round_factor(np.array([0.497, 1.7, 0.00102])).tolist()
    [0.5, 1.7, 0.001]
    """
    nearest = _USUAL[np.argmin(np.abs(np.log(_USUAL / factors[:, None])), axis=1)]
    return np.where(np.abs(factors / nearest - 1) < _ROUND, nearest, factors)
