"""Check of the channels before an estimate: order, sign, scale, zero, and delay of the forces.

A wrong channel is not a small deviation: estimated tolerances would absorb it, and the candidate
effects of the diagnosis, derivatives at the estimate, would interpret it as cogging or drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from constraints.arrays import Array, Mask
from estimation.diagnostics.channel_fit import UNITS, Candidate
from estimation.diagnostics.channel_lag import describe_channel_lag, describe_lag
from estimation.diagnostics.channel_search import ChannelSearch
from estimation.diagnostics.finding import Assumption, Finding, join_words
from estimation.diagnostics.plausibility import advise_on_scale, is_far
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
_SHOWN_ERROR = 0.005
"""Smallest relative standard deviation of a scale that is shown."""
_ALIKE = 0.8
"""Smallest square of the cosine between forces of a machine and those of its robot file."""
_ASSIGNED = Assumption(
    "the channels are those of the struts, with their signs and zeros",
    "a channel is assigned wrongly",
    "check the cabling and the files of the controller",
)


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

    def corrected(self, section: DataSection) -> dict[str, Any]:
        """Return the keys of the section that is right, without defaults, as in a run file."""
        return _shortened(section.model_dump(exclude_defaults=True) | self.keys)

    def refuse(self, section: DataSection, source: str) -> None:
        """Refuse a recording whose channels certainly contradict the section.

        Raises
        ------
        WrongChannelsError
            It contains the section that is right.
        """
        if not (self.faults and self.sure):
            return
        sentences = "; ".join(sentence for _, sentence in self.faults)
        corrected = self.corrected(section)
        text = "".join(yaml_lines("data", corrected, 2))
        message = f"{sentences}. The section that is right:\n{text.rstrip()}"
        allowed = "this section, or --force to estimate in spite of it"
        problem = Problem(message, Path(source) if source else None, allowed=allowed)
        raise WrongChannelsError([problem], {"data": corrected})

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The finding that reports the faults; empty unless they are certain."""
        if not (self.faults and self.sure):
            return ()
        places, sentences = zip(*self.faults, strict=True)
        found = _ASSIGNED.report_failure(
            f"{'; '.join(sentences)}: that explains the force residuals"
        )
        advice = join_words(f"`data.{key}: {_flow(value)}`" for key, value in self.keys.items())
        return (
            replace(
                found,
                contradiction=f"{_ASSIGNED.contradiction} ({', '.join(places)})",
                advice=f"{advice}, or correct the cables or the home offset, then estimate again",
            ),
        )


def check_channels(
    robot: Robot,
    section: DataSection,
    recording: PeriodicRecording,
    noise: NoiseModel,
    harmonics: int,
    design: FourierTrajectory | None = None,
    *,
    has_units: bool = False,
) -> ChannelCheck:
    """Search for channels that explain a recording much better than those of the section.

    All parameters are free, the geometry is the nominal one. With the executed design, its lengths
    determine the channels of the lengths. If the file has their units, another unit is a scale.
    """
    home = robot.inverse_kinematics(robot.home)
    zeros = home if section.length_offsets == "home" else np.array(section.length_offsets)
    least_zeros, least_delay = _least_faults(robot, home, recording.step)
    least = least_zeros, least_delay
    search = ChannelSearch(robot, recording, noise, harmonics, zeros, *least)
    from_home = not (search.possible or np.any(zeros))
    if from_home:
        zeros = home
        lengths = replace(recording.lengths, values=recording.lengths.values + home)
        recording = replace(recording, lengths=lengths)
        search = ChannelSearch(robot, recording, noise, harmonics, zeros, *least)
    given = search.candidate_as_measured()
    found = search.search(design)
    left, gain = search.left(found.excess), given.excess - found.excess
    explained = gain / (gain + left) if gain > search.least(found) else 0.0
    if from_home:  # lengths from zero explain nothing: no pose has them
        explained = 1 - left
    as_given, noise_share = search.explained_variation(given)
    of_found = search.explained_variation(found)[0]
    none = max(as_given, of_found) < max(_LITTLE * (1 - noise_share), _LEAST_EXPLAINED)
    late_error = search.delay_error(found) if found.delay else 0.0
    gain_errors = search.gain_errors(found)
    filtered = any(section.channel_filters("Q"))
    ambiguous = found.low_pass is not None or (found.delay < 0 and filtered)
    lag = ""
    if ambiguous:
        lag = describe_lag(robot, found.delay, found.low_pass, section)
    elif found.channel_lag is not None:
        lag = describe_channel_lag(found.channel_lag, section)
    found = replace(found, delay=0.0) if ambiguous else found
    faults = tuple(_faults(found, late_error, gain_errors))
    margin = found.next_best - found.excess
    sure = left < _LEFT and margin > max(_CLEAR * left, search.least_decrease)
    # Channels that explain mean forces alone, behind a low pass of all variation, are not certain.
    sure = sure and found.channel_lag is None and of_found > _LEAST_CERTAIN_SHARE
    sure = sure and float(np.max(gain_errors)) < _LEAST_CERTAIN_GAIN
    shown = explained, as_given, noise_share
    scale = "" if none else _describe_force_scale(robot, *search.nominal_scale(given))
    if explained < _EXPLAINED or (none and not sure):
        return ChannelCheck((), {}, False, *shown, none, force_scale=scale)
    if not (faults or from_home):
        return ChannelCheck((), {}, False, *shown, none, lag, scale)
    has_units = has_units or not section.units.keys().isdisjoint({"q", *LENGTH_CHANNELS})
    keys = dict(_changed_keys(section, found, zeros, has_units))
    if from_home:
        faults = ("q", "the lengths are measured from home"), *faults
        keys = {"offset": "home"} | keys
    return ChannelCheck(faults, keys, sure, *shown, lag=lag)


def _describe_force_scale(robot: Robot, factor: float, alike: float) -> str:
    """Return the sentence on a factor between measured forces and those of the robot file."""
    if alike < _ALIKE or not is_far(factor):
        return ""
    return (
        f"the forces are about {factor:.2g} times those of the robot file: "
        f"{advise_on_scale(factor, robot.description.drive.torque_per_force)}"
    )


def channel_findings(checks: Sequence[ChannelCheck]) -> tuple[Finding, ...]:
    """Return the findings of all recordings; those of several name the recording."""
    return tuple(
        finding.of_experiment(number) if len(checks) > 1 else finding
        for number, check in enumerate(checks, 1)
        for finding in check.findings
    )


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


def _faults(found: Candidate, late_error: float, gain_errors: Array) -> Iterator[tuple[str, str]]:
    """Yield place and sentence of each fault.

    With the errors of the delay, s, and of the gains of the forces, (6,), relative.
    """
    groups = {"q": found.lengths, "Q": found.forces}
    nouns = {"q": "lengths", "Q": "forces"}
    moved = {key: _numbers(one.channels != np.arange(ACTUATORS)) for key, one in groups.items()}
    orders = {key: tuple(one.channels) for key, one in groups.items()}
    if moved["q"] and orders["q"] == orders["Q"]:
        places = ", ".join(join_words(f"{key}{number}" for number in moved[key]) for key in groups)
        yield places, f"lengths and forces {_in_other_order(moved['q'])}"
    else:
        for key in groups:
            if moved[key]:
                place = join_words(f"{key}{number}" for number in moved[key])
                yield place, f"the {nouns[key]} {_in_other_order(moved[key])}"
    for key, one in groups.items():
        place = join_words(f"{key}{number}" for number in _numbers(one.gains < 0))
        if place:
            yield place, f"{place} {'have' if ' and ' in place else 'has'} the opposite sign"
        sizes = np.abs(one.gains)
        unit = _unit(sizes) if key == "q" else ""
        common = key == "q" and sizes[0] != 1 and np.ptp(sizes) == 0
        if unit:
            yield "q", f"the lengths are in another unit: {unit} if they are stated in m"
        elif common:
            size, word = _misreading(sizes[0])
            yield (
                "q",
                f"all lengths are read {size:.3g} times too {word}: another unit, another number "
                "of counts, or another lead or gear than in the robot file",
            )
        for number in [] if unit or common else _numbers(sizes != 1):
            size, word = _misreading(sizes[number - 1])
            error = size * gain_errors[number - 1] * (key == "Q")
            known = f" ± {error:.1g}" if error > _SHOWN_ERROR * size else ""
            yield f"{key}{number}", f"{key}{number} is read {size:.3g}{known} times too {word}"
    errors = found.lengths.offsets
    shifted = join_words(f"q{number}" for number in _numbers(errors != 0))
    if shifted:
        amounts = join_words(f"{-1e3 * error:.3g}" for error in errors if error)
        zeros = "zeros of {} are" if " and " in shifted else "zero of {} is"
        yield (
            shifted,
            f"the {zeros.format(shifted)} wrong by {amounts} mm (an equal error of a joint "
            "along the strut has the same effect; state what may be left of it as "
            "`tolerances.strut_length`)",
        )
    if found.delay:
        late, early = ("forces", "lengths") if found.delay > 0 else ("lengths", "forces")
        yield (
            "delay",
            f"the {late} lag behind the {early} by {1e3 * abs(found.delay):.3g} ms (± "
            f"{1e3 * late_error:.1g} ms: state that as `tolerances.delay`)",
        )


def _misreading(gain: float) -> tuple[float, str]:
    """Return how many times a reading is too large or too small, by the gain that corrects it."""
    return (1 / gain, "large") if gain < 1 else (gain, "small")


def _unit(gains: Array) -> str:
    """Return the unit of all lengths in terms of the stated one; empty if they have it."""
    return UNITS.get(gains[0], "") if gains[0] != 1 and np.all(gains == gains[0]) else ""


def _numbers(flags: Mask) -> list[int]:
    return [int(j) + 1 for j in np.flatnonzero(flags)]


def _in_other_order(numbers: list[int]) -> str:
    if len(numbers) == 2:  # noqa: PLR2004 - two change places
        return f"{numbers[0]} and {numbers[1]} are swapped"
    return f"{join_words(map(str, numbers))} are in another order"


def _changed_keys(
    section: DataSection, found: Candidate, zeros: Array, has_units: bool
) -> Iterator[tuple[str, Any]]:
    """Yield the keys of `data` that change, with their new values as in a run file."""
    groups = {"q": found.lengths, "Q": found.forces}
    orders, signs, scales = {}, {}, {}
    for key, one in groups.items():
        column = np.argsort(section.channel_order(key))[one.channels]
        orders[key] = (np.argsort(column) + 1).tolist()
        own_sign = np.array(section.channel_signs(key))[one.channels]
        signs[key] = (np.sign(one.gains).astype(int) * own_sign).tolist()
        own_scale = np.array(section.channel_scales(key))[one.channels]
        scales[key] = _rounded(np.abs(one.gains) * own_scale)
    usual = [1] * ACTUATORS
    unit = _unit(np.abs(found.lengths.gains))
    if unit and not has_units:
        scales["q"] = list(section.channel_scales("q"))
        yield "units", section.units | {"q": unit}
    for name, values, given, default in (
        ("order", orders, section.channel_order, list(range(1, ACTUATORS + 1))),
        ("sign", signs, section.channel_signs, usual),
        ("scale", scales, section.channel_scales, usual),
    ):
        if any(value != list(given(key)) for key, value in values.items()):
            changed = {key: value for key, value in values.items() if value != default}
            yield name, values["q"] if values["q"] == values["Q"] else changed
    if np.any(found.lengths.offsets):
        offsets = np.round(1e3 * (zeros + found.lengths.offsets), 2).tolist()
        shown = [f"{value:g} mm" if value else 0 for value in offsets]
        others = {} if not any(section.force_offsets) else {"Q": list(section.force_offsets)}
        yield "offset", {"q": shown, **others}
    if found.delay:
        late = np.array(section.channel_delays("Q")) + found.delay
        delays = {"q": np.array(section.channel_delays("q")), "Q": late}
        names = {"Q": "forces", "q": "lengths"}
        yield (
            "delay",
            {name: _delays(delays[key]) for key, name in names.items() if any(delays[key])},
        )


def _delays(values: Array) -> Any:
    shown = [f"{1e3 * value:.3g} ms" for value in values]
    return shown[0] if len(set(shown)) == 1 else shown


def _rounded(values: Array) -> list[float | int]:
    return [int(value) if value == int(value) else float(f"{value:.3g}") for value in values]


def _shortened(value: Any) -> Any:
    """Return a section with one value where all struts have the same, and whole numbers as such.

    >>> _shortened({"counts_per_revolution": (4096.0,) * 6, "start": 1.5})
    {'counts_per_revolution': 4096, 'start': 1.5}
    """
    if isinstance(value, dict):
        return {key: _shortened(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        items = [_shortened(item) for item in value]
        return items[0] if len(items) == ACTUATORS and items.count(items[0]) == ACTUATORS else items
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _flow(value: Any) -> str:
    """Return a value as in a YAML file, on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    return str(value)
