"""Check of the channel assignment: signs of forces, order of channels, zeros of lengths.

A wrong sign or order is not a small deviation: the candidate effects, derivatives at the estimate,
would interpret it as cogging, drives or delays. Here the model is refitted to the recording under
each alternative assignment, with a coarse model: poses by forward kinematics, a Fourier series with
the motion's harmonics, exact signs of friction, Gauss–Markov. The sums of squares are compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg as sla

from constraints.arrays import Array
from estimation.diagnostics.attribution import Attribution
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.diagnostics.joint_system import Places
from estimation.estimators.experiment import Experiment
from estimation.estimators.priors import ParameterPriors
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import root_of_pseudo_inverse
from estimation.processing.periodic_recording import Channels
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot
from expdesign.trajectory import PhaseBasis

_SHARE = 0.75
"""Share of the residuals beyond the noise that another assignment must explain."""
_LEAST = 40.0
"""Least decrease of the sum of squares, in variances; by chance it has a probability of 1e-10."""
_ALIKE = 0.02
"""Relative difference within which the simpler of two assignments is reported."""
_ROWS, _SINGLE_ROWS = 600, 2000
"""Largest number of rows in use: means over periods, or single samples."""
_DETERMINED = 1e-12
_ZEROS = ("length_zero", "joint")
"""Hypotheses that are equivalent, or nearly so, to the zero of a length."""
_NEWTON_STEPS = 8
_OUT_OF_REACH = 1e3
"""Largest coordinate of a pose, m or rad."""
_REACHED = 1e-6
"""Largest error of a length, m."""
_SETTLED = 1e-3
_SAME = np.arange(ACTUATORS)
_ALIKE_SIGNS = np.ones(ACTUATORS)
_STEP = 1e-4
"""Step of a length for its slope, m."""
_STEPS = 5
_FURTHEST = 0.2
"""Largest error of a zero, relative to the mean length of the strut."""

_Words = tuple[str, str, str]
"""Place, sentence and advice."""

_ASSIGNED = Assumption(
    "the channels are those of the struts, with their signs and zeros",
    "a channel is assigned wrongly",
    "check the cabling and the files of the controller",
)


@dataclass(frozen=True)
class Assignment:
    """Alternative assignment of the channels that explains the recording."""

    place: str
    """Channels in words."""
    sentence: str
    advice: str
    explained: float
    """Decrease of the sum of squares over the rows in use, in variances."""

    @property
    def finding(self) -> Finding:
        """Finding that reports the assignment."""
        return replace(
            _ASSIGNED.report_failure(f"{self.sentence}: that explains the force residuals"),
            contradiction=f"{_ASSIGNED.contradiction} ({self.place})",
            advice=self.advice,
        )


def assignment_findings(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    attributions: Sequence[Attribution],
) -> tuple[Finding, ...]:
    """Check the channels of every experiment, given the attribution of its residuals."""
    found = []
    pairs = zip(experiments, attributions, strict=True)
    for number, (experiment, attribution) in enumerate(pairs, 1):
        other = other_assignment(robot, experiment, priors, _largest_effect_statistic(attribution))
        if other is not None:
            several = len(experiments) > 1
            found.append(other.finding.of_experiment(number) if several else other.finding)
    return tuple(found)


def _largest_effect_statistic(attribution: Attribution) -> float:
    """Return the largest χ² of all hypotheses except zeros of lengths."""
    seen = [
        float(np.nanmax(test.statistic))
        for kind, test in attribution.first.families.items()
        if test.tested and kind not in _ZEROS
    ]
    return max(seen, default=0.0)


def other_assignment(
    robot: Robot, experiment: Experiment, priors: ParameterPriors, rival: float = 0.0
) -> Assignment | None:
    """Return an assignment that explains the recording much better than the given one, or None.

    It must explain at least as much as a rival effect, χ² of the whole recording. None after
    pointwise kinematics.
    """
    if experiment.fit is None:
        return None
    recording = _Recording(robot, experiment, priors)
    columns = recording.columns(recording.lengths)
    if columns is None:
        return None
    own = recording.fit(columns)
    wanted = max(_LEAST, _SHARE * (own.squares - own.freedom), rival * recording.share)
    found = [one for one in recording.alternatives(columns, own) if one.explained >= wanted]
    if not found:
        return None
    most = max(one.explained for one in found)
    return next(one for one in found if one.explained >= (1 - _ALIKE) * most)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Fit of the forces under one assignment."""

    squares: float
    """Sum of squares, in variances."""
    freedom: int
    rest: Array
    """(6 R,), whitened residuals."""
    mass: float
    """Mass of the platform, kg; positive if it is not estimated."""


class _Recording:
    """Rows of one experiment, and the model along alternative lengths."""

    def __init__(self, robot: Robot, experiment: Experiment, priors: ParameterPriors) -> None:
        recording = experiment.recording
        if experiment.fit is None:
            raise ValueError("pointwise kinematics have no Fourier series")
        self.robot, self.motion = robot, experiment.fit.motion
        count = len(robot.parameter_names)
        self.free, self.start = priors.free[:count], priors.start[:count]
        self.lengths_at, self.lengths, _ = _thin_rows(recording.lengths)
        noise = experiment.noise.forces
        self._filter = noise.filter
        self.forces_at, forces, counts = _thin_rows(
            recording.forces, whole=noise.filter is not None
        )
        self.share = len(forces) / len(recording.forces.values)
        lower = np.linalg.cholesky(noise.covariance)
        self._inverse = sla.solve_triangular(lower, np.eye(ACTUATORS), lower=True)
        self._weights = np.sqrt(counts)
        self.forces = self._whiten(forces)

    def _whiten(self, rows: Array) -> Array:
        """Whiten forces (R, 6), or columns (R, 6, k), and flatten rows and channels."""
        rows = rows if self._filter is None else self._filter(rows)
        mixed = np.tensordot(rows, self._inverse, (1, 1))
        mixed = mixed if rows.ndim < 3 else mixed.transpose(0, 2, 1)  # noqa: PLR2004 - columns
        scaled = (mixed.T * self._weights).T
        return scaled.reshape(scaled.shape[0] * ACTUATORS, *scaled.shape[2:])

    @cached_property
    def _basis(self) -> Array:
        basis = PhaseBasis.at(self.motion.omega * self.lengths_at, self.motion.harmonics)
        return np.asarray(np.linalg.pinv(basis.value), np.float64)

    def columns(self, lengths: Array) -> Array | None:
        """Return A along lengths (R', 6), (R, 6, m); None if the machine cannot reach them.

        Plain Newton steps start from the estimated motion and from home. Lengths without a solution
        are impossible for this machine.
        """
        own = self.motion.at(self.lengths_at).state()[:, :COORDINATES]
        starts = (own, np.broadcast_to(self.robot.home, own.shape))
        found = (self._poses(lengths, start) for start in starts)
        poses = next((each for each in found if each is not None), None)
        if poses is None:
            return None
        motion = HarmonicMotion((self._basis @ poses).T, self.motion.omega)
        pose, rate, acceleration = np.split(motion.at(self.forces_at).state(), 3, axis=1)
        columns = self.robot.regressor(pose, rate, acceleration)
        return columns if np.all(np.isfinite(columns)) else None

    def _poses(self, lengths: Array, poses: Array) -> Array | None:
        """Return the poses (R', 6) of lengths, starting at given poses; None if Newton fails."""
        off = np.full_like(lengths, np.inf)
        for _ in range(_NEWTON_STEPS):
            found, jacobian = self.robot.lengths_and_jacobian(poses)
            off = lengths - found
            try:
                poses = poses + np.linalg.solve(jacobian, off[:, :, None])[:, :, 0]
            except np.linalg.LinAlgError:
                return None
            if not np.all(np.abs(poses) < _OUT_OF_REACH):
                return None
        return poses if np.max(np.abs(off)) < _REACHED else None

    def fit(self, columns: Array, strut_of: Places = _SAME, signs: Array = _ALIKE_SIGNS) -> _Fit:
        """Fit the forces; every channel has a sign and belongs to a strut, (6,) each."""
        rows = self._whiten(columns[:, strut_of] * signs[:, None])
        forces = self.forces - rows[:, ~self.free] @ self.start[~self.free]
        rows = rows[:, self.free]
        root = root_of_pseudo_inverse(rows.T @ rows, _DETERMINED)
        found = root @ (root.T @ (rows.T @ forces))
        rest = forces - rows @ found
        names = [n for n, free in zip(self.robot.parameter_names, self.free, strict=True) if free]
        mass = float(found[names.index(MASS)]) if MASS in names else 1.0
        return _Fit(float(rest @ rest), rest.size - root.shape[1], rest, mass)

    def alternatives(self, columns: Array, own: _Fit) -> Iterator[Assignment]:
        """Yield alternative assignments, the simplest first."""

        def assignment(fit: _Fit, words: _Words) -> Assignment:
            return Assignment(*words, explained=own.squares - fit.squares)

        for signs in _signs():
            fit = self.fit(columns, signs=signs)
            # All signs reversed fit equally well, with negative masses.
            if fit.mass > 0:
                yield assignment(fit, _other_signs(signs))
        for strut in range(ACTUATORS):
            zero = self._fit_zero(strut, own)
            if zero is not None:
                yield assignment(zero[0], _other_zero(strut, zero[1]))
        for strut_of in _orders():
            forces, lengths, struts = _other_order(strut_of)
            yield assignment(self.fit(columns, strut_of), forces)
            other = self.columns(self.lengths[:, np.argsort(strut_of)])
            if other is not None:
                yield assignment(self.fit(other), lengths)
                yield assignment(self.fit(other, strut_of), struts)

    def _fit_zero(self, strut: int, own: _Fit) -> tuple[_Fit, float] | None:
        """Fit the zero of a length; return the fit and the correction of the length, m."""
        unit = np.eye(ACTUATORS)[strut]
        furthest = _FURTHEST * float(np.mean(self.lengths[:, strut]))
        best, offset = own, 0.0
        for _ in range(_STEPS):
            shifted = self.columns(self.lengths + (offset + _STEP) * unit)
            if shifted is None:
                break
            slope = (self.fit(shifted).rest - best.rest) / _STEP
            step = -float(slope @ best.rest) / float(slope @ slope)
            trial = float(np.clip(offset + step, -furthest, furthest))
            there = self.columns(self.lengths + trial * unit)
            fit = None if there is None else self.fit(there)
            if fit is None or fit.squares > (1 - _SETTLED) * best.squares:
                break
            best, offset = fit, trial
        return None if best is own else (best, offset)


def _thin_rows(channels: Channels, *, whole: bool = False) -> tuple[Array, Array, Array]:
    """Return times, values and counts of a limited number of rows of a recording's channels.

    With `whole`, return all rows, as a whitening filter requires.
    """
    if whole:
        return channels.times, channels.values, channels.counts
    most = _SINGLE_ROWS if channels.repeats is None else _ROWS
    rows = np.unique(np.linspace(0, len(channels.values) - 1, most).astype(np.intp))
    return channels.times[rows], channels.values[rows], channels.counts[rows]


def _signs() -> Iterator[Array]:
    """Yield signs of the forces that are not all equal, in order of the number of changes."""
    every = (np.array(signs) for signs in product((1, -1), repeat=ACTUATORS))
    changed = [signs for signs in every if 0 < np.count_nonzero(signs < 0) < ACTUATORS]
    yield from sorted(changed, key=lambda signs: int(np.count_nonzero(signs < 0)))


def _orders() -> Iterator[Places]:
    """Yield the strut of each channel: two swapped, counted from another strut, or reversed."""
    numbers = np.arange(ACTUATORS)
    for i, j in combinations(range(ACTUATORS), 2):
        order = numbers.copy()
        order[[i, j]] = j, i
        yield order
    for first in range(ACTUATORS):
        if first:
            yield (numbers + first) % ACTUATORS
        yield (first - numbers) % ACTUATORS


def _other_signs(signs: Array) -> _Words:
    """Return place, sentence and advice for forces with the opposite sign."""
    channels = [f"Q{j + 1}" for j in np.flatnonzero(signs < 0)]
    place, have = join_words(channels), "have" if len(channels) > 1 else "has"
    return (
        place,
        f"{place} {have} the opposite sign",
        f"`data.sign: {{Q: {_format_list(signs)}}}`, times the present signs, if the drives count "
        "in this direction",
    )


def _other_zero(strut: int, offset: float) -> _Words:
    """Return place, sentence and advice for a wrong zero of a length, with its correction, m."""
    shown = ", ".join(f"{1e3 * offset:.3g} mm" if j == strut else "0" for j in range(ACTUATORS))
    return (
        f"q{strut + 1}",
        f"the zero of q{strut + 1} is wrong by {-1e3 * offset:.3g} mm",
        f"reference strut {strut + 1} again (home offset), or `data.offset: {{q: [{shown}]}}`, "
        "added to the present offset; an equal error of a joint along the strut has the same "
        "effect",
    )


def _other_order(strut_of: Places) -> tuple[_Words, ...]:
    """Return place, sentence and advice for forces, lengths, and both in another order."""
    changed = [f"{j + 1}" for j in np.flatnonzero(strut_of != np.arange(ACTUATORS))]
    swapped = f"{join_words(changed)} are in another order"
    if len(changed) == 2:  # noqa: PLR2004 - two change places
        swapped = f"{changed[0]} and {changed[1]} are swapped"
    forces, lengths = (join_words([f"{group}{number}" for number in changed]) for group in "Qq")
    written = _format_list(strut_of + 1)
    remedy = "or swap the columns of the file, or the cables"
    return (
        (forces, f"the forces {swapped}", f"`data.order: {{Q: {written}}}`, {remedy}"),
        (lengths, f"the lengths {swapped}", f"`data.order: {{q: {written}}}`, {remedy}"),
        (
            f"{lengths}, {forces}",
            f"lengths and forces {swapped}",
            f"`data.order: {written}`, or the robot file's joints in the order of the channels",
        ),
    )


def _format_list(values: NDArray[Any]) -> str:
    return f"[{', '.join(str(value) for value in values.tolist())}]"
