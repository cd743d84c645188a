"""Sentences on faults and lags of the channels, and the keys of `data` that correct them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from constraints.arrays import Array, Mask
from estimation.channels.wiring import UNITS, Candidate, ChannelLag, Wiring
from estimation.diagnostics.finding import join_words
from estimation.diagnostics.plausibility import advise_on_scale, is_far, misread_unit
from estimation.processing import NoiseModel, PeriodicRecording, PeriodSource
from expdesign.configuration.estimate import FORCE_CHANNELS, DataSection
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot

_SHOWN_ERROR = 0.005
"""Smallest relative standard deviation of a scale that is shown."""
_SHOWN = 0.02
"""Smallest part of a lag that is stated."""
_LOUD = 10.0
"""Least median ratio of a force's variance over the period to that of its noise, for which a force
without motion is named."""
_SAME_UNIT = 0.01
"""Relative difference of two factors of a unit."""
_ALIKE = 0.8
"""Smallest square of the cosine between forces of a machine and those of its robot file."""


def describe_faults(
    found: Candidate, late_error: float, gain_errors: Array
) -> Iterator[tuple[str, str]]:
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
            f"{1e3 * late_error:.2g} ms: state that as `tolerances.delay`)",
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


def changed_keys(
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
        scales[key] = _scaled(own_scale, np.abs(one.gains))
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
        offsets = 1e3 * (zeros + found.lengths.offsets)
        rounded = np.where(found.lengths.offsets, np.round(offsets, 2), offsets)
        shown = [f"{value:.9g} mm" if value else 0 for value in rounded.tolist()]
        others = {} if not any(section.force_offsets) else {"Q": list(section.force_offsets)}
        yield "offset", {"q": shown, **others}
    if found.delay:
        late = np.array(section.channel_delays("Q")) + _three_digits(found.delay)
        delays = {"q": np.array(section.channel_delays("q")), "Q": late}
        names = {"Q": "forces", "q": "lengths"}
        yield (
            "delay",
            {name: _delays(delays[key]) for key, name in names.items() if any(delays[key])},
        )


def _three_digits(found: float) -> float:
    """Return a value that was found with the digits that are shown; stated ones keep all."""
    return float(f"{found:.3g}")


def _delays(values: Array) -> Any:
    """Return delays, s, as in a run file: one if all are equal."""
    shown = [f"{1e3 * each:.6g} ms" if each else 0 for each in values.tolist()]
    return shown[0] if len(set(shown)) == 1 else shown


def _scaled(stated: Array, gains: Array) -> list[float | int]:
    """Return the stated scales times the gains that were found."""
    pairs = zip(stated.tolist(), gains.tolist(), strict=True)
    scales = [float(f"{one * _three_digits(gain):.12g}") for one, gain in pairs]
    return [int(one) if one == int(one) else one for one in scales]


def shortened(value: Any) -> Any:
    """Return a section with one value where all struts have the same, and whole numbers as such.

    >>> shortened({"counts_per_revolution": (4096.0,) * 6, "start": 1.5})
    {'counts_per_revolution': 4096, 'start': 1.5}
    """
    if isinstance(value, dict):
        return {key: shortened(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        items = [shortened(item) for item in value]
        return items[0] if len(items) == ACTUATORS and items.count(items[0]) == ACTUATORS else items
    return int(value) if isinstance(value, float) and value.is_integer() else value


def flow(value: Any) -> str:
    """Return a value as in a YAML file, on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(flow(item) for item in value) + "]"
    return str(value)


def describe_lag(robot: Robot, lag: float, constant: float | None, section: DataSection) -> str:
    """Describe a lag of the forces, s, that may be a delay or a filter, and how to state it.

    It is in addition to the delays and filters of the section.
    """
    if constant is None:
        return (
            f"the lengths lag behind the forces by about {-1e3 * lag:.3g} ms (not certain), or the "
            "forces passed a faster filter than `data.filter` states"
        )
    tolerances = robot.description.tolerances or RobotTolerances()
    missing = [name for name in ("delay", "low_pass") if getattr(tolerances, name) is None]
    rest = join_words(f"`tolerances.{name}`" for name in missing)
    total = lag + constant
    known = "State what is known as `data.delay` and `data.filter`"
    slow = constant > _SHOWN * total and not any(section.channel_filters("Q"))
    late = lag if slow else total
    stated = np.array(section.channel_delays("Q")) + _three_digits(late)
    fits = [f"`data.delay: {{forces: {flow(_delays(stated))}}}`"] if late > _SHOWN * total else []
    cutoff = 1 / (2 * np.pi * constant) if slow else 0.0
    fits += [f"`data.filter: {{Q: {{low_pass: {cutoff:.3g} Hz, order: 1}}}}`"] if slow else []
    parts = (("delay", lag), ("low pass", constant))
    both = [f"a {name} of {1e3 * one:.2g} ms" for name, one in parts if one > _SHOWN * total]
    return (
        f"the forces lag behind the lengths by about {1e3 * total:.3g} ms in all (not certain), by "
        f"a delay, a low pass or both (best fit: {join_words(both)}). {known}, or else the best "
        f"fit, {join_words(fits)}{', and its uncertainty as ' * bool(rest)}{rest}"
    )


def describe_channel_lag(lag: ChannelLag, wiring: Wiring, section: DataSection) -> str:
    """Describe the lag of a single channel that may be a delay or a filter, and how to state it.

    Channel and delays are named by the struts, filters by the channels of the file.
    """
    channel = f"{lag.group}{lag.strut + 1}"
    in_file = section.channel_order(lag.group).index(int(wiring.channels[lag.strut]) + 1) + 1
    late = np.array(section.channel_delays(lag.group))
    late[lag.strut] += _three_digits(lag.seconds)
    cutoff = 1 / (2 * np.pi * lag.seconds)
    noun = {"q": "lengths", "Q": "forces"}[lag.group]
    known = f"{{{noun}: {flow(_delays(late))}}}"
    return (
        f"{channel} lags behind the other channels by about {1e3 * lag.seconds:.3g} ms (not "
        f"certain), by a delay or a low pass. State the delay, `data.delay: {known}`, or the "
        f"filter, `data.filter: {{{lag.group}{in_file}: {{low_pass: {cutoff:.3g} Hz, order: 1}}}}`"
    )


def describe_silent_forces(recording: PeriodicRecording, noise: NoiseModel) -> str:
    """Return the sentence on forces that do not follow the motion, where most others do."""
    forces, used = recording.forces, noise.forces.filter
    variances = noise.forces.variances * np.mean(1 / forces.counts)
    signal = np.var(forces.as_recorded(forces.values), axis=0) / variances
    count = len(forces.values) if used is None else used.count
    silent = _numbers(signal < 1 + 4 * np.sqrt(2 / count))
    fitted = noise.forces.includes_model_error and recording.source is not PeriodSource.NONE
    if not silent or np.median(signal) < _LOUD or fitted:
        return ""
    place = join_words(f"Q{number}" for number in silent)
    verb = "do" if len(silent) > 1 else "does"
    return (
        f"{place} {verb} not follow the motion: only noise varies there. Is the sensor connected, "
        "and is it the column of a measured force?"
    )


def describe_force_scale(
    robot: Robot, section: DataSection, factor: float, alike: float, *, has_unit: bool
) -> str:
    """Return the sentence on a factor between measured forces and those of the robot file.

    If the recording's file states a unit of the forces, the advice is a scale.
    """
    if alike < _ALIKE or not is_far(factor):
        return ""
    advice = advise_on_scale(factor, robot.description.drive.torque_per_force)
    if has_unit and factor > 0:
        scales = [float(f"{one / factor:.2g}") for one in section.channel_scales("Q")]
        scale = f"`data.scale: {{Q: {flow(shortened(scales))}}}`"
        advice = f"their unit in the recording ({scale}) or the masses of the robot file are wrong"
    return f"the forces are about {factor:.2g} times those of the robot file: {advice}"


def _unit_ratio(robot: Robot, section: DataSection, unit: str) -> Array:
    """Return a unit of the forces over that of the section, (6,)."""
    units = section.actuator_units(robot.description)
    stated = units.si_values(section.units.get("Q", "N"))
    return np.array(units.si_values(unit)) / stated


def correct_force_unit(
    robot: Robot,
    section: DataSection,
    keys: Mapping[str, Any],
    factor: float,
    alike: float,
    *,
    has_unit: bool,
) -> tuple[str, dict[str, Any]] | None:
    """Return a sentence on the unit of all forces by their factor, and the key that corrects it.

    Keys are those of the section that other faults change. The key is a scale where the file
    states a unit, or the section one that has another factor to the unit found. None: not certain.
    """
    found = misread_unit(factor, robot.description.drive.torque_per_force)
    if alike < _ALIKE or found is None:
        return None
    free = not has_unit and section.units.keys().isdisjoint(FORCE_CHANNELS)
    if free and np.allclose(_unit_ratio(robot, section, found.unit), found.gain, rtol=_SAME_UNIT):
        return found.sentence, {"units": keys.get("units", section.units) | {"Q": found.unit}}
    scales = keys.get("scale", {key: list(section.channel_scales(key)) for key in ("q", "Q")})
    scales = scales if isinstance(scales, dict) else {"q": scales, "Q": scales}
    usual = [1] * ACTUATORS
    own = scales.get("Q", usual)
    scales |= {"Q": [float(f"{found.gain * each:.6g}") for each in own]}
    size, word = _misreading(found.gain)
    return (
        f"the forces are in another unit than the stated one: they are read {size:.4g} times too "
        f"{word}",
        {"scale": {key: each for key, each in scales.items() if key == "Q" or each != usual}},
    )
