"""Hypotheses on the residuals: families of candidate effects.

The regressor's own columns identify the wrong parameter, and the strut. For held-out data every
column is tested, over all actuators. Fitted data have no score on the columns of the estimated
parameters; there each column is tested in one actuator at a time, to find a parameter that is not
the same in all struts, and fixed parameters are tested with their whole columns. A common gain of
all forces scales all parameters without any residual: it is not observable.

The other families are terms that the robot may lack (inertia of the drives, friction depending on
speed, load or position, offsets, cables, loads of the platform), deviations of the machine from its
file, and errors of the measurement. Each is a row of `_FAMILIES`.

A hum at a multiple of the motion's frequency is the same in every period: contrasts between periods
cancel it, and the mean over the periods keeps it. In the mean residuals it is one line, at the
nearest multiple of the base frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption, join_words
from estimation.diagnostics.hypothesis import MODELLED, Candidates, Family, Hypothesis, Label
from estimation.diagnostics.linearisation import CandidateEffects, Linearisation, Signature
from estimation.diagnostics.significance import HYPOTHESES
from estimation.estimators.joint_equations import DELAY, LOW_PASS
from estimation.processing.hum import mains_frequencies
from estimation.processing.periodic_recording import PeriodicRecording
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.robot.deviation import CHANNEL_DELAYS, LOW_PASSES, toleranced_deviations

_FEWEST_PERIODS = 2
_MULTIPLES = 3
"""Number of multiples of the mains that are considered."""
_DELAYS = (-3.0, -1.0, 0.1, 1.0, 3.0)
"""Delays of the tested secants, in steps of the recording; the small one is a derivative."""
_LAGS = (-3.0, -1.0, 1.0, 3.0)
_LOW_PASSES = (0.3, 1.0, 3.0)
"""Delays and time constants of single channels, the same."""

STRIBECK_VELOCITIES = (0.02, 0.05, 0.12, 0.3)
"""Tested Stribeck velocities, m/s; neighbouring ones overlap."""

_Finder = Callable[[CandidateEffects], Candidates]
_ALL: Label = ("", None)
_EACH: tuple[Label, ...] = tuple(("", j) for j in range(ACTUATORS))
_JOINTS = tuple((end, j) for end in ("base", "platform") for j in range(ACTUATORS))
_JOINTLY = "`ml` among the estimators, which then estimates it, too"


def list_hypotheses(
    effects: CandidateEffects,
    names: tuple[str, ...],
    *,
    held_out: bool,
    experiments: int = 1,
) -> tuple[Hypothesis, ...]:
    """Return the families to test; several experiments share the levels.

    `names` belong to the regressor's columns; if `held_out`, the parameters were not estimated from
    these data.
    """
    own = parameter_hypothesis(effects.part, names, held_out=held_out)
    others = []
    stated = {each.group for each in toleranced_deviations(effects.robot)}
    for declared, find in _FAMILIES:
        found, family = find(effects), _mention_tolerances(declared, stated)
        if found.labels or family.kind != "hum":
            modelled = not found.labels and family.reason_untested == MODELLED
            others.append(Hypothesis(**vars(family), **vars(found), modelled=modelled))
    # In a prediction, or with fixed parameters, the most frequent error is that of a parameter.
    parameters_first = held_out or not np.all(effects.part.free)
    weights = np.array([1.0, *(each.weight for each in others)])
    if parameters_first:
        weights[0] = np.sum(weights[1:])
    levels = (HYPOTHESES / experiments * weights / np.sum(weights)).tolist()
    return tuple(
        replace(hypothesis, level=level)
        for hypothesis, level in zip((own, *others), levels, strict=True)
    )


def _mention_tolerances(family: Family, stated: Collection[str]) -> Family:
    """Return a family whose texts count a tolerance that is stated already."""
    of_term = f"terms.{family.kind}"
    groups = [group for group in (*family.tolerances, of_term) if group in stated]
    if not groups:
        return family
    exceeded = join_words(f"`tolerances.{group}`" for group in groups)
    # What is within the tolerance belongs to the model, estimated or counted.
    if of_term in stated:
        text = f"{family.assumption.text} beyond the stated {exceeded}"
        action = f"state a larger one, or {family.assumption.advice}"
    else:
        text = f"{family.assumption.text}, within the stated {exceeded}"
        action = "measure it, or state a larger one"
    absent = family.absent.replace(family.assumption.text, text, 1)
    advice = f"it exceeds the stated {exceeded}: {action}"
    assumption = replace(family.assumption, text=text, advice=advice)
    # Its secants begin at the estimated delay.
    noun = family.noun.replace("a delay", "a further delay")
    return replace(family, assumption=assumption, absent=absent, noun=noun)


def parameter_hypothesis(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool
) -> Hypothesis:
    """Return the family of the regressor's columns."""
    assumption = Assumption(
        "one value fits all struts",
        "a parameter is not the same in all struts, or was fixed at a wrong value",
        "estimate the fixed parameters (a relative error of a fixed value looks like a common "
        "error of the force constants), or look for a fault in these struts; the model has one "
        "value for all struts",
    )
    if held_out:
        assumption = Assumption(
            "the parameters are right",
            "parameters are wrong",
            "check these parameters against the machine, or identify them on a motion like this "
            "one",
        )
    labels, columns = _parameter_columns(part, names, held_out=held_out)
    return Hypothesis(
        kind="column",
        labels=labels,
        columns=Signature.of_forces(part, columns),
        assumption=assumption,
        noun="another value of",
        absent="no parameter needs a different value in one of the struts (p = {p:.2g})",
        reason_untested="every parameter is estimated and acts in one strut only",
    )


def _parameter_columns(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool
) -> tuple[tuple[Label, ...], Array]:
    labels: list[Label] = []
    columns = []
    for k, name in enumerate(names):
        whole = part.regressors[:, :, k]
        touched = np.flatnonzero(np.any(whole != 0, axis=0))
        if held_out or not part.free[k]:
            labels.append((name, None))
            columns.append(whole)
        if held_out or len(touched) < 2:  # noqa: PLR2004 - a part of one actuator is the whole
            continue
        for strut in touched:
            labels.append((name, int(strut)))
            columns.append(np.where(np.arange(ACTUATORS) == strut, whole, 0.0))
    stacked = np.stack(columns, axis=2) if columns else np.zeros((*part.forces.shape, 0))
    return tuple(labels), stacked


def hidden_hums(recording: PeriodicRecording) -> tuple[tuple[float, int], ...]:
    """Return the mains frequencies, Hz, within one line of a multiple of the motion's frequency.

    Each is returned with that multiple; all are below half of the sampling frequency. For a single
    period none is returned, since every frequency would be.
    """
    if recording.periods < _FEWEST_PERIODS:
        return ()
    base = 1 / recording.period
    found = []
    for frequency in mains_frequencies(1 / recording.step, _MULTIPLES):
        multiple = round(frequency / base)
        if multiple and abs(frequency - multiple * base) < base / recording.periods:
            found.append((frequency, multiple))
    return tuple(found)


def _candidates(
    columns: Signature, labels: Sequence[Label], groups: Sequence[Sequence[int]] = ()
) -> Candidates:
    """Return candidates of one column each, or of groups of columns; none without columns."""
    if not columns.count:
        return Candidates(labels=(), columns=columns)
    return Candidates(labels=tuple(labels), columns=columns, places=tuple(map(tuple, groups)))


def _by_constant(
    effects: CandidateEffects,
    labels: Sequence[Label],
    constants: Sequence[float],
    columns: Callable[[float], Signature],
) -> Candidates:
    """Return candidates for every constant, one for each of its columns and these labels."""
    return Candidates(
        labels=tuple(labels) * len(constants),
        columns=Signature.concatenate([Signature.none(effects.part), *map(columns, constants)]),
        constants=tuple(constant for constant in constants for _ in labels),
        at=lambda label, constant: columns(constant).select([labels.index(label)]),
    )


def _all_and_each(columns: Signature) -> Candidates:
    """Return the sum of six columns as a candidate, and each of them."""
    return _candidates(_with_sum(columns), (_ALL, *_EACH))


def _with_sum(columns: Signature, shares: Array | None = None) -> Signature:
    """Return the sum of all columns times their shares, one by default, and then the columns."""
    if not columns.count:
        return columns
    weights = np.ones((columns.count, 1)) if shares is None else shares[:, None]
    whole = Signature(columns.forces @ weights, columns.lengths @ weights)
    return Signature.concatenate([whole, columns])


def _missing(effects: CandidateEffects, *names: str) -> Signature:
    """Return the columns of terms, if the robot lacks the first of them; otherwise none."""
    if not effects.lacks(names[0]):
        return Signature.none(effects.part)
    return Signature.concatenate([effects.term(name) for name in names])


def _in_actuators(name: str) -> _Finder:
    """Return the finder of a term with one parameter per actuator, or one for all."""

    def find(effects: CandidateEffects) -> Candidates:
        columns = _missing(effects, name)
        if columns.count == 1:
            columns = effects.of_forces(columns.forces * np.eye(ACTUATORS))
        return _all_and_each(columns)

    return find


def _in_groups(*names: str, groups: Mapping[Label, Sequence[int]]) -> _Finder:
    """Return the finder of terms with groups of parameters that are tested jointly."""
    labels, places = tuple(groups), tuple(groups.values())
    return lambda effects: _candidates(_missing(effects, *names), labels, places)


def _stribeck(effects: CandidateEffects) -> Candidates:
    """Return friction near standstill, in all actuators in proportion to their dry friction."""
    speeds = STRIBECK_VELOCITIES if effects.lacks("stribeck") else ()
    values = dict(zip(effects.robot.parameter_names, effects.values, strict=True))
    dry = np.array([max(values.get(name, 1.0), 0.0) for name in actuator_names("r")])
    shares = dry / np.mean(dry) if np.any(dry) else np.ones(ACTUATORS)

    def of_speed(speed: float) -> Signature:
        return _with_sum(effects.term("stribeck", velocity=speed), shares)

    return _by_constant(effects, (_ALL, *_EACH), speeds, of_speed)


def _saturation(effects: CandidateEffects) -> Candidates:
    lacking = effects.lacks("force_saturation")
    return _all_and_each(effects.gains(power=3) if lacking else Signature.none(effects.part))


def _springs(effects: CandidateEffects) -> Candidates:
    """Return springs along the struts, each with a constant force: its rest length is unknown."""
    stiffness = _missing(effects, "cable")
    if stiffness.count:
        constant = effects.of_forces(np.broadcast_to(np.eye(ACTUATORS), stiffness.forces.shape))
        stiffness = Signature.concatenate([_with_sum(stiffness), _with_sum(constant)])
    pairs = [(j, 1 + ACTUATORS + j) for j in range(1 + ACTUATORS)]
    return _candidates(stiffness, (_ALL, *_EACH), pairs)


def _deviations(
    names: Sequence[str], labels: Sequence[Label], groups: Sequence[Sequence[int]] = ()
) -> _Finder:
    """Return the finder of deviations of the machine; none after pointwise kinematics."""

    def find(effects: CandidateEffects) -> Candidates:
        has_motion = effects.motion is not None
        columns = effects.deviations(names) if has_motion else Signature.none(effects.part)
        return _candidates(columns, labels, groups)

    return find


def _delay(effects: CandidateEffects) -> Candidates:
    """Return the delay of all forces, by its secants."""
    step, known = effects.experiment.recording.step, effects.experiment.pointwise
    # A delay that was estimated along a known motion has no columns.
    shown = known is None or (known.motion is not None and not effects.robot.delay_std)
    seconds = tuple(steps * step for steps in _DELAYS) if shown else ()
    return _by_constant(effects, (_ALL,), seconds, effects.delay)


def _of_channels(mixture: Array, steps: Sequence[float], *, alike: bool = False) -> _Finder:
    """Return the finder of secants in single channels, and in all forces `alike`."""
    labels: list[Label] = [(of, j) for of in ("force", "length") for j in range(ACTUATORS)]
    labels += [("forces", None)] * alike

    def find(effects: CandidateEffects) -> Candidates:
        step = effects.experiment.recording.step
        times = [each * step for each in steps] if effects.motion is not None else []

        def secants(seconds: float) -> Signature:
            single = effects.lags(mixture, seconds)
            whole = _with_sum(single.select(range(ACTUATORS))).select(range(int(alike)))
            return Signature.concatenate([single, whole])

        return _by_constant(effects, labels, times, secants)

    return find


def _hums(effects: CandidateEffects) -> Candidates:
    """Return the hums that contrasts between periods cancel."""
    recording, columns = effects.experiment.recording, [Signature.none(effects.part)]
    hidden, width = hidden_hums(recording), 2 * ACTUATORS
    for _, multiple in hidden:
        angle = multiple * recording.omega * recording.forces.times
        pair = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        each = np.einsum("tp,ij->tijp", pair, np.eye(ACTUATORS)).reshape(-1, ACTUATORS, width)
        columns.append(effects.of_forces(effects.part.cells.mean(each)))
    return _candidates(
        Signature.concatenate(columns),
        [(f"of {frequency:g} Hz", None) for frequency, _ in hidden],
        [range(k * width, (k + 1) * width) for k in range(len(hidden))],
    )


def _family(
    kind: str,
    noun: str,
    find: _Finder,
    advice: str,
    *,
    assumed: str = "",
    fails: str = "",
    **more: Any,
) -> tuple[Family, _Finder]:
    """Declare a family; without texts it is a term that the model may lack."""
    assumed = assumed or f"no unmodelled {noun.removeprefix('a ').removeprefix('an ')}"
    more.setdefault("absent", assumed + " (p = {p:.2g})")
    assumption = Assumption(assumed, fails or f"the model lacks {noun}", advice)
    return Family(kind=kind, assumption=assumption, noun=noun, **more), find


def _term(kind: str, noun: str, find: _Finder | None = None, **more: Any) -> tuple[Family, _Finder]:
    """Declare a family that is a term of the catalogue, by default one of the actuators."""
    advice = f"add `{kind}` to the robot's `terms`: it becomes a parameter of the estimate"
    return _family(kind, noun, find or _in_actuators(kind), more.pop("advice", advice), **more)


_OF_MOTION: dict[str, Any] = {
    "reason_untested": "pointwise kinematics and splines have no motion model for it",
    "scale": 1e3,
}
_PLACED: dict[str, Any] = {"phrase": "{noun} ({place})"}
_FAMILIES = (
    _term(
        "drive_inertia",
        "an inertia of the drives",
        advice="add `drive_inertia` to the robot's `terms`, or state a screw or gear as `drive`, "
        "with lead and inertia: a mass along the struts becomes a parameter of the estimate",
        unit="kg",
    ),
    _term(
        "stribeck",
        "friction near standstill",
        _stribeck,
        advice="add `stribeck`, with a `velocity` near this one, to the robot's `terms`: it "
        "becomes a parameter of the estimate, and so does the velocity with `estimate: true`",
        lower=0.0,
        unit="N",
    ),
    _term("load_friction", "friction by load", scale=100.0, unit="%"),
    _term("quadratic_friction", "friction by the square of the speed", unit="N s^2/m^2"),
    _term(
        "asymmetric_friction",
        "a difference of viscous friction between the directions",
        weight=0.5,
        unit="N s/m",
    ),
    _term(
        "position_friction",
        "a change of friction along the stroke",
        _in_groups(
            "position_friction", groups={label: (j, ACTUATORS + j) for j, label in enumerate(_EACH)}
        ),
        weight=0.25,
        unit="N/m, N s/m^2",
    ),
    _term(
        "passive_viscous_friction",
        "viscous friction of the joints",
        _in_groups(
            "passive_viscous_friction", groups={("v_base", None): (0,), ("v_platform", None): (1,)}
        ),
        weight=0.5,
        **_PLACED,
    ),
    _term(
        "general_platform",
        "an asymmetry of the platform",
        _in_groups(
            "general_platform",
            groups={("sx, sy", None): (0, 1), ("Ixy, Ixz, Iyz", None): (2, 3, 4)},
        ),
        advice="state `platform: general` in the robot file: centre of mass and products of "
        "inertia become parameters of the estimate",
        weight=0.5,
        **_PLACED,
    ),
    _term(
        "platform_wrench",
        "a constant load of the platform",
        _in_groups(
            "platform_wrench",
            groups={("f_x, f_y, f_z", None): (0, 1, 2), ("m_x, m_y, m_z", None): (3, 4, 5)},
        ),
        weight=0.25,
        **_PLACED,
    ),
    _term(
        "platform_spring",
        "a spring of the platform",
        # With constant forces or moments, since the rest position is unknown.
        _in_groups(
            "platform_spring",
            "platform_wrench",
            groups={
                ("k_x, k_y, k_z", None): (0, 1, 2, 6, 7, 8),
                ("k_phi, k_theta, k_psi", None): (3, 4, 5, 9, 10, 11),
            },
        ),
        advice="look for hoses, or add `platform_spring` and `platform_wrench` to the robot's "
        "`terms`: they become parameters of the estimate",
        weight=0.25,
        values_shown=3,
        contains="platform_wrench",
        **_PLACED,
    ),
    _term(
        "platform_drag",
        "a drag of the platform",
        _in_groups("platform_drag", groups={("d_x, d_y, d_z", None): (0, 1, 2)}),
        weight=0.25,
        **_PLACED,
    ),
    _term("force_offset", "a constant force", unit="N"),
    _family(
        "gain",
        "a gain error",
        lambda effects: _candidates(effects.gains(), _EACH),
        "state the uncertainty of the force constants, `tolerances.force_constant.each`, with "
        + _JOINTLY,
        tolerances=("force_constant.each",),
        assumed="the forces have the same gain",
        fails="the gain of an actuator's force differs from the others",
        scale=100.0,
        unit="%",
    ),
    _term(
        "force_saturation",
        "a saturating force constant",
        _saturation,
        advice="add `force_saturation`, with a `force` near the largest, to the robot's `terms`: "
        "it becomes a parameter of the estimate",
        weight=0.5,
        scale=100.0,
        unit="% at the largest force",
    ),
    _term(
        "cable",
        "a spring",
        _springs,
        advice="look for cables and hoses, or add `cable` and `force_offset` to the robot's "
        "`terms`: the stiffness becomes a parameter of the estimate",
        unit="N/m",
        values_shown=1,
        contains="force_offset",
    ),
    _family(
        "joint",
        "a displaced joint",
        _deviations(
            [f"{end}_joint_{j + 1}_{axis}" for end, j in _JOINTS for axis in "xyz"],
            _JOINTS,
            [range(k, k + 3) for k in range(0, 3 * len(_JOINTS), 3)],
        ),
        "measure it, or state the uncertainty of the joints, `tolerances.base_joints` and "
        "`tolerances.platform_joints`, with " + _JOINTLY,
        tolerances=("base_joints", "platform_joints"),
        assumed="the joints are where the robot file says",
        fails="a joint is not at its position in the robot file",
        phrase="{place} displaced",
        unit="mm",
        **_OF_MOTION,
    ),
    _family(
        "gravity",
        "a tilt of gravity",
        _deviations(["gravity_1", "gravity_2"], [_ALL], [range(2)]),
        "level the base, or state its uncertainty, `tolerances.gravity`, with " + _JOINTLY,
        tolerances=("gravity",),
        assumed="gravity has the direction of the robot file",
        fails="gravity does not have the direction in the robot file",
        unit="deg",
        **(_OF_MOTION | {"scale": 180 / np.pi}),
    ),
    _family(
        "length_zero",
        "a shifted zero of the length",
        _deviations(actuator_names("strut_length_"), _EACH),
        "reference the strut again, or state the uncertainty of the zeros, "
        "`tolerances.strut_length`, with " + _JOINTLY,
        tolerances=("strut_length",),
        assumed="lengths are measured from where the robot file says",
        fails="the zero of a length is wrong",
        unit="mm",
        **_OF_MOTION,
    ),
    _family(
        "delay",
        "a delay of the forces",
        _delay,
        f"state the uncertainty of the delay, `tolerances.delay`, with {_JOINTLY}; a delay from "
        "the data sheet goes into `data.delay`",
        tolerances=("delay",),
        assumed="forces and lengths are sampled at the same time",
        fails="the forces lag behind the lengths",
        absent="forces and lengths are sampled at the same time (a further delay of "
        "{value:.3g} ± {std:.1g} ms)",
        sized_by_constant=True,
        number=".3g",
        unit="ms",
        **_OF_MOTION,
    ),
    _family(
        "lag",
        "a lag of the",
        _of_channels(DELAY, _LAGS),
        "set it as `data.delay`, one for each channel; or state the uncertainty of the delays, "
        "`tolerances.channel_delay`, with " + _JOINTLY,
        tolerances=tuple(CHANNEL_DELAYS.values()),
        assumed="all channels are sampled at the same time",
        fails="a channel lags behind the others",
        weight=0.5,
        sized_by_constant=True,
        unit="ms",
        **_OF_MOTION,
    ),
    _family(
        "low_pass",
        "a low pass of the",
        _of_channels(LOW_PASS, _LOW_PASSES, alike=True),
        "set it as `data.filter`, with `order: 1` and the cut-off 1/(2π) over this time constant; "
        "or state the uncertainty of the time constants, `tolerances.low_pass`, with " + _JOINTLY,
        tolerances=tuple(LOW_PASSES.values()),
        assumed="no channel is filtered",
        fails="a first-order low pass acts on the measurement",
        weight=0.5,
        lower=0.0,
        sized_by_constant=True,
        unit="ms",
        **_OF_MOTION,
    ),
    _family(
        "hum",
        "a hum",
        _hums,
        "earth and shield the measurement, or state the frequency in "
        "`noise.force_spectrum.hum` of the run and design again: the motion then avoids it",
        assumed="no hum that repeats in every period",
        fails="the mains hum at a multiple of the motion's frequency",
        absent="no hum of the mains at a multiple of the motion's frequency (p = {p:.2g})",
        unit="N",
        paired=True,
    ),
)
"""Families with the finders of their candidates, without that of the parameters.

Rare effects have a smaller weight. A common gain of all forces is not among the candidates: it is
not observable.
"""
