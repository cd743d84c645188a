"""Candidate effects and their conditional tests: families of hypotheses, and pitch scans.

A `Hypothesis` states the columns of its candidates, their level and their description;
`evaluate_hypothesis` tests every candidate, given known effects.

Cogging is periodic in a strut's length. For strut j and pitch τ the columns sin(2π l_j/τ) and
cos(2π l_j/τ) of actuator j are tested jointly. Their statistic is χ² with two degrees of freedom at
every pitch; its maximum over all pitches exceeds u with a probability of at most (Davies,
Biometrika 74, 1987)

    P ≤ e^(−u/2) (1 + √(u/2π) ∫ √λ₂ df),   √λ₂ = 2π std(l_j),

with Rice's rate of upcrossings of the envelope of the two components, f = 1/τ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field
from scipy.optimize import brentq, minimize_scalar

from constraints.arrays import Array
from estimation.diagnostics import joint_system, significance
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.whitened_rows import Places
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms import parameter_unit, term_definitions
from expdesign.runfolder import OpenNumber, OpenNumbers, described

Label = tuple[str, int | None]
"""Parameter, or empty, and actuator (from 0; None: all of them)."""
_ALIKE = 0.5
"""Share of a family's level for an effect in all struts alike, where single struts are tested, too:
parts of one type have an effect together, and one strut has a fault."""
MODELLED = "the model has the term, or its columns explain the effect"
"""Reason why no candidate of a family can be tested."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Family:
    """Declaration of candidate effects that are tested and described alike."""

    kind: str
    """Kind of the effects."""
    weight: float = 1.0
    """Share of the level of all families, relative to the others."""
    assumption: Assumption
    """Assumption that there is no such effect."""
    tolerances: tuple[str, ...] = ()
    """Groups of the deviations that are such effects."""
    noun: str
    """Noun for such an effect, such as ``a constant force``."""
    absent: str
    """Sentence if none was found; a format of `p`, and of `value` and `std` of the most significant
    candidate."""
    reason_untested: str = MODELLED
    """Reason for an omitted test, if there is no candidate."""
    sized_by_constant: bool = False
    """Whether the best constant is the size of the effect, such as the delay of its secant."""
    scale: float = 1.0
    """Factor from SI to the displayed unit."""
    number: str = "+.3g"
    """Format of a displayed value."""
    unit: str = ""
    """Displayed unit; empty: that of the candidate's parameter."""
    values_shown: int | None = None
    """Number of a candidate's values that are displayed; None: all."""
    paired: bool = False
    """Whether values are pairs of sine and cosine; their amplitudes are displayed."""
    phrase: str = "{noun} {place}"
    """Format of the noun and the place of an effect."""
    lower: float = -np.inf
    """Smallest value of a physical effect, SI, where the parameters of its term may be smaller."""
    contains: str = ""
    """Kind of the effects that are special cases of this one, and therefore no rivals."""

    def unit_of(self, label: str) -> str:
        """Return the displayed unit of a candidate, whose label may list several parameters."""
        return self.unit or parameter_unit(label.split(",", maxsplit=1)[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """Candidate effects of one family in one experiment."""

    labels: tuple[Label, ...]
    """Labels of the candidates. Candidates with equal labels differ in a constant (a speed)."""
    columns: Signature
    """Columns of all candidates, per SI unit of the effect."""
    places: tuple[tuple[int, ...], ...] = ()
    """Indices of every candidate's columns; by default one each, in their order."""
    constants: tuple[float, ...] = ()
    """Constant of every candidate, SI; by default none."""
    at: Callable[[Label, float], Signature] | None = None
    """Function for the columns of a candidate with another constant, to find the best one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypothesis(Family, Candidates):
    """Family of candidate effects with its candidates and their level."""

    level: float = significance.HYPOTHESES
    """Level of all candidates together."""
    modelled: bool = False
    """Whether the model has a term for it: then there is no assumption to test."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of a candidate's values, SI: also those of the first parameter of its term."""
        term = term_definitions().get(self.kind)
        if term is None:
            return self.lower, np.inf
        return max(self.lower, term.parameters[0].lower), term.parameters[0].upper

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.labels)

    def columns_of(self, candidate: int) -> Places:
        """Return the indices of a candidate's columns in the family."""
        own = self.places[candidate] if self.places else (candidate,)
        return np.array(own, dtype=np.intp)

    def constant_of(self, candidate: int) -> float:
        """Return a candidate's constant; NaN if the family has none."""
        return self.constants[candidate] if self.constants else np.nan


@dataclass(frozen=True, eq=False)
class HypothesisTest:
    """Tests of every candidate of a family."""

    hypothesis: Hypothesis
    first: int
    """Index of its first column in the projection."""
    fits: tuple[joint_system.EffectFit, ...]
    """Fit of each candidate alone; of rank 0 if it cannot be tested."""
    log_p: Array
    """(n,), log p of each candidate; NaN if it cannot be tested."""
    limits: Array
    """(n,), largest log p of each candidate that is significant."""

    @property
    def tested(self) -> int:
        """Number of candidates that can be tested."""
        return int(np.count_nonzero(np.isfinite(self.log_p)))

    @property
    def best(self) -> int:
        """Index of the most significant candidate; -1 if none can be tested."""
        return int(np.nanargmin(self.log_p - self.limits)) if self.tested else -1

    @property
    def best_p(self) -> float:
        """Its p, corrected for the family; 1 if none can be tested."""
        if not self.tested:
            return 1.0
        relative = self.log_p[self.best] - self.limits[self.best]
        return min(1.0, self.hypothesis.level * float(np.exp(relative)))

    def places(self, candidate: int) -> Places:
        """Return the indices of a candidate's columns in the projection."""
        return self.hypothesis.columns_of(candidate) + self.first


def evaluate_hypothesis(
    conditional: joint_system.ConditionalScores, hypothesis: Hypothesis, first: int
) -> HypothesisTest:
    """Test every candidate alone; the family's columns start at `first` in the projection."""
    numbers = range(hypothesis.candidates)
    fits = tuple(conditional.fit(hypothesis.columns_of(number) + first) for number in numbers)
    statistic = np.array([fit.statistic for fit in fits])
    rank = np.array([fit.rank for fit in fits], dtype=np.float64)
    log_p, tested = np.full(len(fits), np.nan), rank > 0
    log_p[tested] = significance.log_tail(statistic[tested], rank[tested], conditional.freedom)
    shares = np.ones(len(fits))
    alike = np.array([strut is None for _, strut in hypothesis.labels], dtype=bool)
    for kind, share in ((tested & alike, _ALIKE), (tested & ~alike, 1 - _ALIKE)):
        shares[kind] = share / max(int(np.count_nonzero(kind)), 1)
    # Bonferroni's correction with weights: the levels of all tested candidates add to the family's.
    limits = np.log(hypothesis.level * shares / (np.sum(shares[tested]) or 1.0))
    return HypothesisTest(hypothesis, first, fits, log_p, limits)


@dataclass(frozen=True, eq=False)
class CandidateResult:
    """Test of one candidate."""

    parameter: Annotated[
        str, described("", "parameters, base or platform, force or length; or empty")
    ]
    actuator: Annotated[
        significance.Strut, described("1", "number of the actuator; null: all of them")
    ]
    constant: Annotated[OpenNumber, described("SI", "constant of the columns; null: none")]
    statistic: Annotated[OpenNumber, described("1", "χ²; null: it cannot be tested")]
    freedom: Annotated[
        float, Field(alias="degrees_of_freedom"), described("1", "identifiable combinations")
    ]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p, uncorrected")]
    values: Annotated[OpenNumbers, described("SI", "estimated size")]
    std: Annotated[OpenNumbers, described("SI", "standard deviations of the values")]
    detectable: Annotated[
        OpenNumbers,
        described("SI", "smallest values that are detected with `power`, whatever the others are"),
    ]
    failed: Annotated[bool, described("", "the effect is significant")]


@dataclass(frozen=True, eq=False)
class HypothesisResult:
    """Tests of all candidates of a family, as stored."""

    kind: Annotated[str, described("", "kind of the family")]
    power: Annotated[float, described("1", "power of the test at `detectable`")]
    family_level: Annotated[float, described("1", "level of all candidates together")]
    tested: Annotated[int, described("1", "number of candidates that can be tested")]
    candidates: Annotated[tuple[CandidateResult, ...], described("", "candidates one by one")]

    @classmethod
    def of(cls, test: HypothesisTest, freedom: float) -> Self:
        """Convert a test with a noise of these degrees of freedom."""
        hypothesis = test.hypothesis
        rows = []
        for number, (name, strut) in enumerate(hypothesis.labels):
            fit = test.fits[number]
            values, std = fit.values, np.sqrt(np.diag(fit.covariance))
            if not fit.rank and not hypothesis.places:
                values = std = np.full(1, np.nan)
            limit = float(test.limits[number])
            far = significance.noncentrality(limit, fit.rank, freedom) if fit.rank else np.nan
            rows.append(
                CandidateResult(
                    parameter=name,
                    actuator=strut,
                    constant=hypothesis.constant_of(number),
                    statistic=fit.statistic if fit.rank else np.nan,
                    freedom=float(max(fit.rank, 1)),
                    log_p=float(test.log_p[number]),
                    values=values,
                    std=std,
                    detectable=np.sqrt(far) * std,
                    failed=bool(test.log_p[number] < limit),
                )
            )
        return cls(hypothesis.kind, significance.POWER, hypothesis.level, test.tested, tuple(rows))


PERIODIC = Family(
    kind="position-periodic",
    assumption=Assumption(
        "no position-periodic force",
        "a force is periodic in the strut's length",
        "compensate it in the drives, or add `cogging` with this `pitch` to the robot's `terms` "
        "(and `cogging_second` for half of it): it biases the parameters by more than their "
        "intervals show",
    ),
    noun="a position-periodic force",
    absent="no strut has a position-periodic force (p = {p:.2g})",
)
"""Forces periodic in a strut's length, whose candidates a scan of the pitches finds."""
SAMPLES_PER_PITCH = 4.0
"""Smallest number of samples per pitch at the largest speed; shorter pitches are not scanned."""
_OVERSAMPLING = 4
_SEEN = 1e-6
"""Smallest share of a column's information that must remain given the model's columns."""


@dataclass(frozen=True, eq=False)
class PitchScan:
    """Scan of the pitches of one strut."""

    strut: int
    pitches: Array
    statistic: Array
    """(P,), pitches, m, descending, and the statistic of each, with two degrees of freedom; empty
    if the strut moves too little or too fast."""
    best_pitch: float
    best: float
    """Pitch of the largest statistic, refined between the points of the scan, and its value; NaN
    and 0 for an empty scan."""
    log_p: float
    """Logarithm of p, over all pitches of this strut."""
    critical: float
    """Statistic that is significant over all struts and pitches."""
    reach: float
    """∫ √λ₂ df over the scan."""


@dataclass(frozen=True)
class PeriodicForce:
    """Force amplitude · sin(2π length / pitch + phase) in one strut."""

    pitch: Annotated[float, described("m", "period in the strut's length")]
    pitch_std: Annotated[float, described("m", "its standard deviation")]
    amplitude: Annotated[float, described("N", "amplitude")]
    amplitude_std: Annotated[float, described("N", "its standard deviation")]
    phase: Annotated[float, described("rad", "at length zero: its error is mostly the pitch's")]
    phase_std: Annotated[float, described("rad", "its standard deviation")]
    centre: Annotated[float, described("m", "mean length of the strut")]
    centre_phase: Annotated[float, described("rad", "phase at that length")]
    centre_phase_std: Annotated[float, described("rad", "its standard deviation")]


def scan_pitches(
    solved: joint_system.SolvedSystem,
    part: Linearisation,
    strut: int,
    step: float,
    level: float = significance.POSITION_PERIODIC,
) -> PitchScan:
    """Scan the pitches of one strut, with samples `step` apart, s.

    The level covers all struts and pitches together.
    """
    length = part.position[:, strut]
    frequencies = _frequencies(length, part.speed[:, strut], step)
    if not len(frequencies):
        nothing = np.zeros(0)
        return PitchScan(strut, nothing, nothing, np.nan, 0.0, 0.0, np.inf, 0.0)
    pair_statistic = _pair_statistic(solved, strut, length - np.mean(length))
    statistic = pair_statistic(frequencies)
    top = int(np.argmax(statistic))
    spacing = frequencies[1] - frequencies[0]
    found = minimize_scalar(
        lambda f: -float(pair_statistic(f)[0]),
        bounds=(
            max(frequencies[0], frequencies[top] - spacing),
            min(frequencies[-1], frequencies[top] + spacing),
        ),
        method="bounded",
    )
    best, frequency = max((-float(found.fun), float(found.x)), (statistic[top], frequencies[top]))
    reach = 2 * np.pi * float(np.std(length)) * (frequencies[-1] - frequencies[0])
    freedom = solved.system.freedom
    return PitchScan(
        strut=strut,
        pitches=1 / frequencies,
        statistic=statistic,
        best_pitch=1 / frequency,
        best=best,
        log_p=log_exceedance(best, reach, freedom),
        critical=critical_value(level / ACTUATORS, reach, freedom),
        reach=reach,
    )


def log_exceedance(statistic: float, reach: float, freedom: float) -> float:
    """Return the logarithm of the bound on P(largest statistic of one strut > statistic).

    `reach` is ∫ √λ₂ df over the scan, `freedom` the degrees of freedom of Σ.
    """
    log_p = float(significance.log_tail(np.array(statistic), np.array(2), freedom))
    return min(0.0, log_p + float(np.log1p(np.sqrt(statistic / (2 * np.pi)) * reach)))


def critical_value(level: float, reach: float, freedom: float) -> float:
    """Return the statistic with at most this probability of being exceeded in one strut."""
    highest = 100.0
    while log_exceedance(highest, reach, freedom) > np.log(level):
        highest *= 2
    return float(brentq(lambda u: log_exceedance(u, reach, freedom) - np.log(level), 0.0, highest))


def periodic_columns(
    part: Linearisation, strut: int, pitch: float, coefficients: tuple[float, float]
) -> Array:
    """Return the columns of sine, cosine and a change of 1/pitch, (R, 6, 3)."""
    length = part.position[:, strut]
    centred = length - np.mean(length)
    angle = 2 * np.pi * centred / pitch
    a, b = coefficients
    columns = np.zeros((len(length), part.position.shape[1], 3))
    columns[:, strut, 0] = np.sin(angle)
    columns[:, strut, 1] = np.cos(angle)
    columns[:, strut, 2] = 2 * np.pi * centred * (a * np.cos(angle) - b * np.sin(angle))
    return columns


def periodic_force(
    part: Linearisation, strut: int, pitch: float, coefficients: Array, covariance: Array
) -> PeriodicForce:
    """Convert the coefficients of the three columns to amplitude, pitch and phase."""
    a, b, shift = coefficients
    frequency = max(1 / pitch + shift, _LONGEST / pitch)
    amplitude = float(np.hypot(a, b))
    centre = float(np.mean(part.position[:, strut]))
    centre_phase = float(np.arctan2(b, a))
    phase = centre_phase - 2 * np.pi * frequency * centre
    to_amplitude = np.array([a, b, 0.0]) / amplitude
    to_phase = np.array([-b, a, 0.0]) / amplitude**2
    to_origin = to_phase - np.array([0.0, 0.0, 2 * np.pi * centre])

    def std(slope: Array) -> float:
        return float(np.sqrt(slope @ covariance @ slope))

    return PeriodicForce(
        pitch=float(1 / frequency),
        pitch_std=float(np.sqrt(covariance[2, 2]) / frequency**2),
        amplitude=amplitude,
        amplitude_std=std(to_amplitude),
        phase=float(np.mod(phase + np.pi, 2 * np.pi) - np.pi),
        phase_std=std(to_origin),
        centre=centre,
        centre_phase=centre_phase,
        centre_phase_std=std(to_phase),
    )


_LONGEST = 0.1
"""Smallest frequency, relative to that of the scan, up to which its correction is linear."""


def _frequencies(length: Array, speed: Array, step: float) -> Array:
    """Return 1/pitch, from one pitch per stroke to the shortest resolved by the samples."""
    stroke = float(np.ptp(length))
    if stroke <= 0:
        return np.zeros(0)
    finest = float(np.max(np.abs(speed))) * step
    highest = 1 / (SAMPLES_PER_PITCH * finest) if finest > 0 else 0.0
    count = int(np.floor((highest * stroke - 1) * _OVERSAMPLING)) + 1
    if count < 2:  # noqa: PLR2004 - a scan has two ends
        return np.zeros(0)
    return (1 + np.arange(count) / _OVERSAMPLING) / stroke


def _pair_statistic(
    solved: joint_system.SolvedSystem, strut: int, length: Array
) -> Callable[[Array | float], Array]:
    """Return a function for χ² of sine and cosine of a strut's length, by their frequencies."""
    system = solved.system
    residual = solved.weighted_rest[:, strut]
    weight = system.force_rows.quadratic(strut)
    one = np.ones((1, len(length)))
    whole = float(weight(one, one)[0])

    def statistic(frequencies: Array | float) -> Array:
        angle = 2 * np.pi * np.multiply.outer(np.atleast_1d(frequencies), length)
        sin, cos = np.sin(angle), np.cos(angle)
        scores = np.stack([sin @ residual, cos @ residual], axis=1)
        sin_mixed, cos_mixed = np.split(solved.explain(strut, np.concatenate([sin, cos])), 2)
        ss = weight(sin, sin) - np.sum(sin_mixed**2, axis=1)
        sc = weight(sin, cos) - np.sum(sin_mixed * cos_mixed, axis=1)
        cc = weight(cos, cos) - np.sum(cos_mixed**2, axis=1)
        determinant = ss * cc - sc**2
        seen = determinant > _SEEN * whole**2 / 4
        value = cc * scores[:, 0] ** 2 - 2 * sc * scores[:, 0] * scores[:, 1]
        value = value + ss * scores[:, 1] ** 2
        return np.where(seen, value / np.where(seen, determinant, 1.0), 0.0)

    return statistic
