"""Search for the order, sign, scale and zero of the channels of a recording, and for their lags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from constraints.arrays import Array
from estimation.channels.lag import (
    LagSearch,
    columns_of_lags,
    delays_to_try,
    with_channel_lag,
)
from estimation.channels.model import MOST_SHIFTED, MUCH_BETTER, ChannelModel
from estimation.channels.readings import MOST_LATE
from estimation.channels.wiring import STRUTS, Candidate, Wiring
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.trajectory import FourierTrajectory

_ROUND_THE_BASE = [
    (first + turn * STRUTS) % ACTUATORS
    for first in range(ACTUATORS)
    for turn in (1, -1)
    if (first, turn) != (0, 1)
]
"""Orders that count the struts from another one, or backwards."""
_FACTORS = (2.0, 0.5)
_SMALL = 0.01
_MOSTLY = 0.4
"""Share of the unexplained forces that a delay or the zero of a length may leave."""
_ZERO_DIGITS = 0.05
_ZEROS = np.array([-16, -8, -4, -2, -1, 0, 1, 2, 4, 8, 16])
"""Errors of a length's zero that are tried, in smallest faults."""
_RIGHT = len(_ZEROS) // 2
"""Place of no error."""
_FAR_OFF = 9.0
"""Ratio of unexplained forces from which on a larger error of the same zero leaves more, too: it
changes the forces by more than twice what is unexplained."""
_LAGS = np.geomspace(0.5, MOST_LATE, 24)
"""Lags that are tried, in steps of the recording."""
_SIGMAS = 2.0
_LEAST_SHARE = 0.2
"""Share of the unexplained forces that one of several faults must explain."""
_ROUNDS = 4
_EACH = np.eye(ACTUATORS)


class ChannelSearch:
    """Search for the wiring that explains most, by a model of the recording.

    Zeros of the lengths that are only `assumed` give way to those of the executed design.
    """

    def __init__(self, model: ChannelModel, *, assumed: bool = False) -> None:
        self.model, self.assumed = model, assumed
        self.undecided = True
        """Whether neither design nor forces show which zeros of the lengths are right."""
        self.differences: Array | None = None
        """(6,), m, mean lengths less those of the design; None: it was not executed."""
        self._known: dict[tuple[Wiring, Wiring], LagSearch] = {}

    def search(self, design: FourierTrajectory | None) -> Candidate:
        """Return the wiring that explains most, found by single changes.

        Order, sign and scale of the lengths come from the design, if they can. Discrete changes
        are tried first, then the zero of a length and the value of the delay.
        """
        known, self.differences = (
            None if design is None else self.model.wiring_of_design(design)
        ) or (None, None)
        self.undecided = known is None
        measured = Wiring.as_measured()
        measured = replace(measured, gains=self.model.unit * measured.gains)
        best = self.model.candidate(known or measured, 0.0)
        # The machine may stand elsewhere than planned, or move less: the forces decide.
        lengths, plainer = best.lengths, list[Wiring]()
        if np.any(lengths.offsets):
            plainer.append(replace(lengths, offsets=np.zeros(ACTUATORS)))
        if np.any(np.abs(lengths.gains) != self.model.unit):
            plainer.append(replace(lengths, gains=self.model.unit * np.sign(lengths.gains)))
        tried = [best, *(self.model.candidate(one, 0.0) for one in plainer)]
        best = min(tried, key=lambda each: each.excess)
        best = self._choose_zeros(best, tried)
        for _ in range(_ROUNDS):
            if self.model.left(best.excess) < _SMALL or best.channel_lag is not None:
                break
            tried = [
                self.model.candidate(*each) for each in self._neighbours(best, known is not None)
            ]
            if not tried:
                break
            found = min(tried, key=lambda one: one.excess)
            others = (one.excess for one in tried if self.model.differs(one, found))
            found = replace(found, next_best=min(found.next_best, *others, np.inf))
            late = self._lags(best).best(best), with_channel_lag(self.model, best)
            refined = *late, *self._zeros(best, 1 - _LEAST_SHARE)
            moved = min(refined, key=lambda one: one.excess)
            if moved.excess < found.excess and self._is_no_imitation(best, moved):
                found = moved
            if best.excess - found.excess < max(
                self.model.least_decrease, _LEAST_SHARE * best.excess
            ):
                break
            best = found
        best = self._without_small_zeros(best)
        for _ in range(_ROUNDS):
            if best.channel_lag is not None:
                break
            tried = [self._lags(best).best(best), with_channel_lag(self.model, best)]
            if best.excess > self.model.least_decrease:
                tried += self._zeros(best, _MOSTLY)
            found, *rest = sorted(tried, key=lambda one: one.excess)
            decrease = best.excess - found.excess
            # What is left may be an error of the noise, which is the same with and without a lag.
            least = max(self.model.least(found), (1 / _MOSTLY - 1) * self.model.left(found.excess))
            if decrease < least or not self._is_no_imitation(best, found):
                break
            # The lag of one channel is a part of that of all, and no other wiring.
            next_ones = [one.excess for one in rest if one.channel_lag is None]
            best = replace(found, next_best=min([found.next_best, *next_ones]))
        return self._simplest(self._lags(best).split(best))

    def _choose_zeros(self, best: Candidate, tried: Sequence[Candidate]) -> Candidate:
        """Choose between given zeros and other ones of all lengths, by the executed design.

        The machine may also stand elsewhere than planned: the forces must be clear. Each is
        compared behind its own lag: left in both, one hides what the zeros explain.
        """
        most = 0 if self.assumed else MOST_SHIFTED
        moved = [one for one in tried if np.count_nonzero(one.lengths.offsets) > most]
        if not moved or not (self.assumed or np.any(best.lengths.offsets)):
            return best
        shifted = min(moved, key=lambda each: each.excess)
        given = [each for each in tried if not np.any(each.lengths.offsets)]
        plain = min(given, key=lambda each: each.excess)
        late, other = (self._lags(each).best(each).excess for each in (shifted, plain))
        least = max(self.model.least_decrease, (MUCH_BETTER - 1) * self.model.left(late))
        gain = other - late
        self.undecided = abs(gain) <= least
        if gain > (-least if self.assumed else least):
            return replace(shifted, next_best=min(shifted.next_best, other))
        return plain

    def _lags(self, present: Candidate) -> LagSearch:
        """Return the search for the lag with the channels of a candidate, begun once."""
        channels = present.lengths, present.forces
        if channels not in self._known:
            self._known[channels] = LagSearch(self.model, *channels)
        return self._known[channels]

    def _simplest(self, found: Candidate) -> Candidate:
        """Return the wiring with the fewest channels in another order among equal ones.

        A symmetric machine is the same with its struts counted from another one, or backwards.
        """

        def count_moved(one: Candidate) -> int:
            orders = one.lengths.channels, one.forces.channels
            return sum(int(np.count_nonzero(order != STRUTS)) for order in orders)

        best = found
        for order in _ROUND_THE_BASE:
            lengths, forces = found.lengths.reorder(order), found.forces.reorder(order)
            other = replace(found, lengths=lengths, forces=forces)
            if count_moved(other) < count_moved(best):
                fit = self.model.fit(self.model.motion(lengths), found.delay, found.low_pass or 0.0)
                excess = fit.excess(forces)
                if not self.model.is_better(found.excess, excess):
                    best = replace(other, excess=excess)
        return best

    def _without_small_zeros(self, found: Candidate) -> Candidate:
        """Return the wiring without errors of zeros that are no fault, and with the best delay."""
        lengths = found.lengths
        large = np.abs(lengths.offsets) >= self.model.least_zeros
        lengths = replace(lengths, offsets=np.where(large, lengths.offsets, 0.0))
        found = replace(found, lengths=lengths)
        columns = columns_of_lags(self.model, found, self.model.motion(lengths))(found.channel_lag)
        fit = self.model.fit_columns(columns)
        found = replace(found, excess=fit.excess(found.forces))
        return self._lags(found).delay_near(found, found.delay) if found.delay else found

    def least_lag(self, found: Candidate, over_the_rest: float) -> float:
        """Return the smallest lag of all forces that would change the channels of a candidate, s.

        It must explain more than what stays unexplained, `over_the_rest` times.
        """
        needed = max(
            self.model.least(replace(found, delay=self.model.step)),
            over_the_rest * self.model.left(found.excess),
        )
        noise = _SIGMAS * np.sqrt(self.model.variance_of(found))
        for late in (self.model.step * _LAGS).tolist():
            effect = self.model.effect_of_lag(found, late)
            # An effect in one strut may explain a part of the rest, and of the lag as well.
            both = np.sqrt(self._imitated_shares(found, effect))
            if np.sqrt(self.model.share(effect)) - noise > max(
                np.sqrt(needed), float(np.sum(both))
            ):
                return max(self.model.least_delay, late)
        return np.inf

    def _is_no_imitation(self, present: Candidate, found: Candidate) -> bool:
        """Return whether a delay or a zero explains more than any effect in one strut."""
        (most,) = self._imitated_shares(present)
        return present.excess - found.excess > max(self.model.least(found), most)

    def _imitated_shares(self, present: Candidate, *others: Array) -> list[float]:
        """Return the share of the forces that the best effect in one strut explains.

        And the same of `others`, (R, 6) each. The effects are a constant force, a spring, a gain
        and an inertia.
        """
        motion = self.model.motion(present.lengths)
        fit = self.model.fit(motion, present.delay, present.low_pass or 0.0)
        state = np.split(motion.at(self.model.force_times).state(), 3, axis=1)
        struts = self.model.robot.strut_motion(*state)
        shapes = (
            np.ones_like(self.model.forces),
            struts.length - np.mean(struts.length, axis=0),
            self.model.robot.regressor(*state) @ fit.parameters(present.forces),
            struts.length_acceleration,
        )
        own = np.concatenate(
            [self.model.whiten(each)[:, :, None] * _EACH for each in shapes], axis=2
        )
        rests = self.model.residuals(present, fit), *others
        return [self.model.largest_share(own, rest, fit) for rest in rests]

    def _neighbours(self, present: Candidate, known: bool) -> Iterator[tuple[Wiring, float]]:
        """Yield lengths and delays that differ by one change; delays only for known lengths."""
        lengths, delay = present.lengths, present.delay
        yield from ((lengths, late) for late in delays_to_try(self.model.step, self.model.period))
        if known:
            return
        for order in _length_orders():
            yield lengths.reorder(order), delay
        means = np.mean(lengths.apply(self.model.readings), axis=0)
        for strut in range(ACTUATORS):
            yield lengths.scale(strut, -1.0, means[strut]), delay
            for factor in (-1.0, *_FACTORS):
                yield lengths.scale(strut, factor), delay

    def _zeros(self, present: Candidate, most: float) -> list[Candidate]:
        """Return wirings with another zero of one length.

        Zeros that promise to leave more than the share `most` are left out. If lengths that differ
        from those of the executed design explain the forces nearly as well, no others are wrong:
        forces alone confuse zeros with errors of joints.
        """
        found = [self._at_zero(present, strut, most) for strut in range(ACTUATORS)]
        if self.differences is None:
            return found
        differing = self.model.stand_out(self.differences)
        if not np.any(differing):
            return found
        offsets = np.where(differing, -self.differences, present.lengths.offsets)
        lengths = replace(present.lengths, offsets=offsets)
        fit = self.model.fit(self.model.motion(lengths), present.delay, present.low_pass or 0.0)
        own = replace(present, lengths=lengths, excess=fit.excess(present.forces))
        if self.model.is_better(min(one.excess for one in found), own.excess):
            return found
        return [own] if np.all(np.abs(offsets) >= self.model.least_zeros, where=differing) else []

    def _at_zero(self, present: Candidate, strut: int, most: float) -> Candidate:
        """Return the wiring with the zero of one length that explains most."""
        near = self.model.regular_motion(present.lengths)

        def excess(offset: float) -> float:
            motion = self.model.motion(present.lengths.shift(strut, offset), near)
            return self.model.fit(motion, present.delay, present.low_pass or 0.0).excess(
                present.forces
            )

        # On both sides: the curve is no parabola far from the minimum, and may mislead near zero.
        step = self.model.least_zeros[strut]
        offsets, values = step * _ZEROS, np.full(len(_ZEROS), np.inf)
        values[_RIGHT] = present.excess
        for outwards in (range(_RIGHT - 1, -1, -1), range(_RIGHT + 1, len(_ZEROS))):
            for place in outwards:
                values[place] = excess(offsets[place])
                if values[place] > _FAR_OFF * present.excess:
                    break
        best = int(np.argmin(values[1:-1])) + 1
        if offsets[best] == 0 or values[best] > most * present.excess:
            return present
        found = minimize_scalar(
            excess,
            bounds=(offsets[best - 1], offsets[best + 1]),
            method="bounded",
            options={"xatol": _ZERO_DIGITS * step},
        )
        offset = float(found.x)
        if abs(offset) < step:
            return present
        return replace(
            present, lengths=present.lengths.shift(strut, offset), excess=float(found.fun)
        )


def _length_orders() -> Iterator[NDArray[np.intp]]:
    """Yield orders with two struts swapped, counted from another strut, or reversed."""
    for i, j in combinations(range(ACTUATORS), 2):
        order = STRUTS.copy()
        order[[i, j]] = j, i
        yield order
    yield from _ROUND_THE_BASE
