"""Check of the channels before an estimate: order, sign, scale, zero, and delay of the forces.

A wrong channel is not a small deviation: estimated tolerances would absorb it, and the candidate
effects of the diagnosis, derivatives at the estimate, would interpret it as cogging or drives.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.channels.lag import delay_error
from estimation.channels.model import MOST_SHIFTED, ChannelModel
from estimation.channels.readings import TooLittleMotionError
from estimation.channels.report import (
    changed_keys,
    correct_force_unit,
    describe_channel_lag,
    describe_faults,
    describe_force_scale,
    describe_lag,
    describe_silent_forces,
    flow,
    shortened,
)
from estimation.channels.search import ChannelSearch
from estimation.channels.wiring import STRUTS, Candidate, Wiring
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.processing import NoiseModel, PeriodicRecording
from expdesign.configuration import InputError, Problem
from expdesign.configuration.estimate import LENGTH_CHANNELS, DataSection
from expdesign.configuration.run import yaml_lines
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory

_LEAST_ZERO = 2e-3
"""Smallest error of a length's zero that is a fault, relative to the length."""
_LEAST_DELAY = 0.75
"""Smallest delay that is a fault, in steps of the recording."""
_TOLERATED = 4.0
"""Standard deviations of a tolerance that are no fault of a channel."""
_EXPLAINED = 0.75
"""Share of the forces beyond the noise that other channels must explain."""
_LITTLE, _LEAST_EXPLAINED = 0.5, 0.05
"""Smallest share of the forces' variation that their channels explain, without and with noise."""
_LEFT = 0.02
"""Largest unexplained share of the forces with channels that are certain."""
_CLEAR = 4.0
"""Ratio of the unexplained forces of the next best channels to those of the best."""
_LEAST_CERTAIN_SHARE = 0.01
"""Smallest share of the forces' variation that channels explain which are certain."""
_LEAST_CERTAIN_GAIN = 0.1
"""Relative standard deviation from which on the scale of a force is not certain."""
_ASSIGNED = Assumption(
    "the channels are those of the struts, with their signs and zeros",
    "a channel is assigned wrongly",
    "check the cabling and the files of the controller",
)

_SAME_ZEROS = Assumption(
    "recording and controller measure the lengths from the same zeros",
    "recording and controller measure a length from different zeros",
    "compare the home offsets of both",
)
_BY_CHANCE = 1e-3
"""Probability of different zeros of struts that are all alike."""


class WrongChannelsError(InputError):
    """Channels of a recording that contradict the section `data`, with the section that is right.

    `details` has this section for programs.
    """

    def __init__(
        self, problems: Iterable[Problem], details: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        super().__init__(problems)
        self.details = dict(details)


@dataclass(frozen=True)
class ChannelCheck:
    """Channels of a recording that explain it better than those of the section `data`."""

    faults: tuple[tuple[str, str], ...]
    """Place and sentence of each fault; empty: none was found."""
    keys: dict[str, Any]
    """Keys of `data` that change, with their values as in a run file."""
    sure: bool
    """Whether no other channels explain the recording nearly as well."""
    explained: float
    """Share of the forces beyond the noise that the other channels explain."""
    as_given: float | None = None
    """Share of the variation of the forces that the channels of the section explain; None: they
    were not checked."""
    noise: float = 0.0
    """Share of the variation of the forces that is noise."""
    unexplained: bool = False
    """Whether neither the channels of the section nor others explain the forces."""
    lag: str = ""
    """Sentence on a lag of the forces that may be a delay, a filter or both; empty: none."""
    force_scale: str = ""
    """Sentence on a factor of all forces that no machine of the kind has; empty: none."""
    silent: str = ""
    """Sentence on forces that do not follow the motion; empty: all of them do."""
    zeros: Finding | None = None
    """Lengths that differ from those of the executed design by a constant, unlike the others."""
    unchecked: str = ""
    """Reason for which the channels were not checked; empty: they were."""
    least_lag: Callable[[], float] = lambda: 0.0
    """Returns the smallest lag of the forces that this recording would have shown, s."""
    clock: str = ""
    """Sentence on the clock of the recording, if it is another than that of the motion."""

    @property
    def rest(self) -> float:
        """Share of the variation of the forces that the section's channels leave beyond noise."""
        return max(1 - (self.as_given or 0.0) - self.noise, 0.0)

    def corrected(self, section: DataSection) -> dict[str, Any]:
        """Return the keys of the section that is right, without defaults, as in a run file."""
        return shortened(section.model_dump(exclude_defaults=True) | self.keys)

    def with_force_unit(self, unit: tuple[str, dict[str, Any]] | None) -> ChannelCheck:
        """Add a sentence on the unit that all forces certainly have, and its key."""
        if unit is None:
            return self
        return replace(
            self,
            faults=(*self.faults, ("Q", unit[0])),
            keys=self.keys | unit[1],
            sure=self.sure or not self.faults,
            force_scale="",
        )

    def sections(self, section: DataSection) -> dict[str, dict[str, Any]]:
        """Return the sections of the run file that are right: `data`, and that of the clock."""
        clock = {"estimate": {"frequency": "estimated"}} if self.clock else {}
        return {"data": self.corrected(section), **clock}

    def refuse(self, section: DataSection, source: str) -> None:
        """Refuse a recording whose clock or channels certainly contradict the run.

        Raises
        ------
        WrongChannelsError
            It contains the section that is right.
        """
        known = self if self.sure else replace(self, faults=(), keys={})
        if not (known.clock or known.faults):
            return
        sentences = "; ".join(filter(None, (self.clock, *(each for _, each in known.faults))))
        right = known.sections(section)
        text = "".join(line for key, one in right.items() for line in yaml_lines(key, one, 2))
        message = f"{sentences}. The section that is right:\n{text.rstrip()}"
        allowed = "this section, or --force to estimate in spite of it"
        problem = Problem(message, Path(source) if source else None, allowed=allowed)
        raise WrongChannelsError([problem], right)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings that report different zeros, and the faults if they are certain."""
        zeros = () if self.zeros is None else (self.zeros,)
        if not (self.faults and self.sure):
            return zeros
        places, sentences = zip(*self.faults, strict=True)
        keys = join_words(f"`data.{key}: {flow(value)}`" for key, value in self.keys.items())
        found = _ASSIGNED.fails(
            f"{'; '.join(sentences)}: that explains the force residuals",
            where=", ".join(places),
            advice=f"{keys}, or correct the cables or the home offset",
        )
        return found, *zeros


def check_channels(
    robot: Robot,
    section: DataSection,
    recording: PeriodicRecording,
    noise: NoiseModel,
    harmonics: int | None,
    design: FourierTrajectory | None = None,
    *,
    has_units: Collection[str] = (),
) -> ChannelCheck:
    """Search for channels that explain a recording much better than those of the section.

    All parameters are free, the geometry is the nominal one. With the executed design, its lengths
    determine the channels of the lengths. `has_units` are the groups of channels of which the file
    has units: another unit of the lengths is then a scale. The harmonics are those of the motion;
    None: it has no period, and is a spline through the lengths.

    Raises
    ------
    MotionFitError
        A recording without a period is too short.
    """
    silent = describe_silent_forces(recording, noise)
    try:
        model, from_home = _model_of_section(robot, section, recording, noise, harmonics)
    except TooLittleMotionError as error:
        return ChannelCheck((), {}, sure=False, explained=0.0, silent=silent, unchecked=str(error))
    zeros = model.zeros
    given = model.candidate_as_measured()
    search = ChannelSearch(model, assumed=from_home)
    found = search.search(design)
    by_splines = harmonics is None and noise.forces.includes_model_error
    unexplained = model.left(found.excess) > 0 and found.channel_lag is None
    # Splines through the forces follow noise with a memory: their scatter shows a part of it.
    if by_splines and unexplained and model.take_rest_as_noise(found):
        given = model.candidate_as_measured()
        search = ChannelSearch(model, assumed=from_home)
        found = search.search(design)
    left, gain = model.left(found.excess), given.excess - found.excess
    explained = gain / (gain + left) if gain > model.least(found) else 0.0
    if from_home:  # lengths from zero explain nothing: no pose has them
        explained = 1 - left
    as_given, noise_share = model.explained_variation(given)
    of_found = model.explained_variation(found)[0]
    none = max(as_given, of_found) < max(_LITTLE * (1 - noise_share), _LEAST_EXPLAINED)
    gain_errors = model.gain_errors(found)
    filtered = any(section.channel_filters("Q"))
    ambiguous = found.low_pass is not None or (found.delay < 0 and filtered)
    lag = _lag_in_words(robot, section, found, ambiguous=ambiguous)
    found = replace(found, delay=0.0) if ambiguous else found
    late_error = delay_error(model, found) if found.delay else 0.0
    # Without stated zeros none of them is wrong.
    named = replace(found.lengths, offsets=np.zeros(ACTUATORS)) if from_home else found.lengths
    faults = tuple(describe_faults(replace(found, lengths=named), late_error, gain_errors))
    sure = _is_certain(model, found, of_found, gain_errors)
    shown = explained, as_given, noise_share
    accepted = explained >= _EXPLAINED and (sure or not none)
    factor = model.nominal_scale(found if accepted else given)
    has_unit = "Q" in has_units
    scale = "" if none else describe_force_scale(robot, section, *factor, has_unit=has_unit)
    if not (accepted and (faults or from_home)):
        check = ChannelCheck((), {}, False, *shown, none, lag if accepted else "", scale)
        least_lag = partial(search.least_lag, found, _EXPLAINED / (1 - _EXPLAINED))
        check = replace(check, least_lag=least_lag)
    else:
        stated = "q" in has_units or not section.units.keys().isdisjoint({"q", *LENGTH_CHANNELS})
        keys = dict(changed_keys(section, found, zeros, stated))
        if from_home:
            # Only a design that was executed shows where the readings begin.
            sure = sure and not search.undecided
            faults = ("q", _unstated_zeros(found.lengths, undecided=search.undecided)), *faults
            keys = {"offset": "home"} | keys
        check = ChannelCheck(faults, keys, sure, *shown, lag=lag, force_scale=scale)
    check = replace(
        check,
        silent=silent,
        zeros=None
        if from_home or (check.sure and "offset" in check.keys)
        else find_different_zeros(robot, section, found, zeros, search.differences),
    )
    corrected = partial(correct_force_unit, robot, section, check.keys, *factor)
    return check.with_force_unit(None if check.unexplained else corrected(has_unit=has_unit))


def _model_of_section(
    robot: Robot,
    section: DataSection,
    recording: PeriodicRecording,
    noise: NoiseModel,
    harmonics: int | None,
) -> tuple[ChannelModel, bool]:
    """Return the model with the zeros of the section, and whether they had to be those at home.

    Readings about zero are no lengths; where the section states no zeros, they count from home.
    """
    home = robot.inverse_kinematics(robot.home)
    zeros = home if section.length_offsets == "home" else np.array(section.length_offsets)
    least = _least_faults(robot, home, recording.step)
    model = ChannelModel(robot, recording, noise, harmonics, zeros, *least)
    if model.possible or np.any(zeros):
        return model, False
    lengths = replace(recording.lengths, values=recording.lengths.values + home)
    recording = replace(recording, lengths=lengths)
    return ChannelModel(robot, recording, noise, harmonics, home, *least), True


def _is_certain(model: ChannelModel, found: Candidate, explained: float, errors: Array) -> bool:
    """Return whether no other channels explain the forces nearly as well.

    Channels that explain mean forces alone, behind a low pass of all variation, are not certain.
    Errors are those of the gains.
    """
    left, margin = model.left(found.excess), found.next_best - found.excess
    return (
        (left < _LEFT and margin > max(_CLEAR * left, model.least_decrease))
        and (found.channel_lag is None and explained > _LEAST_CERTAIN_SHARE)
        and float(np.max(errors)) < _LEAST_CERTAIN_GAIN
    )


def _lag_in_words(robot: Robot, section: DataSection, found: Candidate, *, ambiguous: bool) -> str:
    if ambiguous:
        return describe_lag(robot, found.delay, found.low_pass, section)
    lag = found.channel_lag
    if lag is None:
        return ""
    return describe_channel_lag(lag, found.lengths if lag.group == "q" else found.forces, section)


def _unstated_zeros(lengths: Wiring, *, undecided: bool) -> str:
    if np.any(lengths.offsets):
        return "no key states the zeros of the lengths, and the executed design has them elsewhere"
    if undecided:
        return (
            "the lengths are measured from home, or from zeros that only an executed design shows"
        )
    return "the lengths are measured from home"


def channel_findings(checks: Sequence[ChannelCheck]) -> tuple[Finding, ...]:
    """Return the findings of all recordings; those of several name the recording."""
    return tuple(
        finding.name_experiment(number, len(checks))
        for number, check in enumerate(checks, 1)
        for finding in check.findings
    )


def find_different_zeros(
    robot: Robot, section: DataSection, found: Candidate, zeros: Array, differences: Array | None
) -> Finding | None:
    """Return the finding on lengths that differ from those commanded, if they alone do so.

    A controller that follows lengths reads those of the design, from its own zeros; a displaced
    joint, or poses that it follows otherwise, move all lengths. The others are the scale of the
    test, Student's t. None without an executed design.
    """
    if differences is None:
        return None
    tolerances = robot.description.tolerances or RobotTolerances()
    stated = np.array(tolerances.strut_length or [0.0] * ACTUATORS)
    least = np.where(
        stated > 0, _TOLERATED * stated, _LEAST_ZERO * robot.inverse_kinematics(robot.home)
    )
    order = np.argsort(-np.abs(differences))
    for count in range(1, MOST_SHIFTED + 1):
        far, others = np.sort(order[:count]), differences[order[count:]]
        scale = max(float(np.sqrt(np.mean(others**2))), np.finfo(float).tiny)
        t = float(np.min(np.abs(differences[far]))) / scale
        p = 2 * float(scipy.special.comb(ACTUATORS, count) * scipy.stats.t.sf(t, len(others)))
        if p < _BY_CHANCE and np.all(np.abs(differences[far]) > least[far]):
            names = join_words(f"q{strut + 1}" for strut in far)
            amounts = join_words(f"{1e3 * each:+.3g} mm" for each in differences[far])
            moved = np.where(np.isin(STRUTS, far), -differences, 0.0)
            mended = replace(found, lengths=replace(found.lengths, offsets=moved))
            key = dict(changed_keys(section, mended, zeros, has_units=True))["offset"]
            most = 1e3 * float(np.max(np.abs(others)))
            sentence = (
                f"{names} differ{'s' * (count == 1)} from the length{'s' * (count > 1)} that the "
                f"executed design commands by {amounts}, the others by at most {most:.2g} mm"
            )
            advice = f"{_SAME_ZEROS.advice}; if the recording is wrong, `data.offset: {flow(key)}`"
            return _SAME_ZEROS.fails(sentence, p, _BY_CHANCE, names, advice)
    return None


def _least_faults(robot: Robot, home: Array, step: float) -> tuple[Array, float]:
    """Return the smallest faults of zeros, (6,), m, and of the delay, s: beyond the tolerances."""
    tolerances = robot.description.tolerances or RobotTolerances()
    own = np.array(tolerances.strut_length or [0.0] * ACTUATORS) ** 2
    for joints in (tolerances.base_joints, tolerances.platform_joints):
        if joints is not None:
            own = own + np.max(np.array(joints) ** 2, axis=1)
    zeros = np.maximum(_LEAST_ZERO * home, _TOLERATED * np.sqrt(own))
    each = tolerances.channel_delay
    own_delay = max(each.forces) if each is not None and each.forces else 0.0
    late = float(np.hypot(tolerances.delay or 0.0, own_delay))
    return zeros, max(_LEAST_DELAY * step, _TOLERATED * late)
