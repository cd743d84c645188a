"""Hypotheses on the residuals: families of candidate effects.

The regressor's own columns identify the wrong parameter, and the strut. For held-out data every
column is tested, over all actuators. Fitted data have no score on the columns of the estimated
parameters; there each column is tested in one actuator at a time, to find a parameter that is not
the same in all struts, and fixed parameters are tested with their whole columns. A common gain of
all forces scales all parameters without any residual: it is not observable.

The other families are terms that the robot may lack (inertia of the drives, friction depending on
speed or load, offsets, cables), and deviations of the machine from its file.

A hum at a multiple of the motion's frequency is the same in every period: contrasts between periods
cancel it, and the mean over the periods keeps it. In the mean residuals it is one line, at the
nearest multiple of the base frequency.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.hypothesis import MODELLED, Hypothesis, Label
from estimation.diagnostics.linearisation import CandidateEffects, Linearisation, Signature
from estimation.diagnostics.significance import HYPOTHESES
from estimation.processing.hum import mains_frequencies
from estimation.processing.periodic_recording import PeriodicRecording
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.mechanism.terms import term_definitions

_FEWEST_PERIODS = 2
_MULTIPLES = 3
"""Number of multiples of the mains that are considered."""
_DELAYS = (-3.0, -1.0, 0.1, 1.0, 3.0)
"""Delays of the tested secants, in steps of the recording; the small one is a derivative."""

STRIBECK_VELOCITIES = (0.02, 0.05, 0.12)
"""Tested Stribeck velocities, m/s; neighbouring ones overlap."""

_EACH: tuple[Label, ...] = tuple(("", j) for j in range(ACTUATORS))
_ALL_AND_EACH: tuple[Label, ...] = (("", None), *(("", j) for j in range(ACTUATORS)))
_POINTWISE = "pointwise kinematics have no motion model for deviations"
_JOINTLY = "`estimate.systematic: estimated`, which includes it in the estimate"


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
    others = [
        _inertia(effects),
        *_friction(effects),
        *_forces(effects),
        *_geometric_errors(effects),
        _delay(effects),
        *hum_hypotheses(effects),
    ]
    # In a prediction, or with fixed parameters, the most frequent error is that of a parameter.
    parameters_first = held_out or not np.all(effects.part.free)
    weights = np.ones(1 + len(others))
    weights[0] = len(others) if parameters_first else 1.0
    levels = (HYPOTHESES / experiments * weights / np.sum(weights)).tolist()
    return tuple(
        replace(
            hypothesis,
            level=level,
            modelled=hypothesis.kind in term_definitions() and not effects.lacks(hypothesis.kind),
        )
        for hypothesis, level in zip((own, *others), levels, strict=True)
    )


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


def _forces(effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield errors of one actuator: offset, gain, and a spring along the strut."""
    part = effects.part
    offsets = effects.missing_term("force_offset")
    yield Hypothesis(
        kind="force_offset",
        labels=_EACH if offsets.count else (),
        columns=offsets,
        assumption=Assumption(
            "no constant force in an actuator",
            "an actuator has a constant force that the model lacks",
            "add `force_offset` to the robot's `terms`: the offsets become parameters of the "
            "estimate",
        ),
        noun="a constant force",
        absent="no actuator has an unmodelled constant force (p = {p:.2g})",
        unit=lambda _: "N",
    )
    yield Hypothesis(
        kind="gain",
        labels=_EACH,
        columns=effects.gains(),
        assumption=Assumption(
            "the forces have the same gain",
            "the gain of an actuator's force differs from the others",
            "state the uncertainty of the force constants, `tolerances.force_constant.each`, with "
            + _JOINTLY,
        ),
        noun="a gain error",
        absent="no actuator's force has a different gain (p = {p:.2g})",
        scale=100.0,
        unit=lambda _: "%",
    )
    springs = Signature.none(part)
    if effects.lacks("cable"):
        # Each with a constant force, since the rest length is unknown.
        middle = np.mean(part.position, axis=0)
        stretch = effects.term("cable", rest_length=0.0).forces - np.eye(ACTUATORS) * middle
        constant = np.broadcast_to(np.eye(ACTUATORS), stretch.shape)
        springs = Signature.of_forces(part, np.concatenate([stretch, constant], axis=2))
    yield Hypothesis(
        kind="cable",
        labels=_EACH if springs.count else (),
        columns=springs,
        places=tuple((j, ACTUATORS + j) for j in range(ACTUATORS)) if springs.count else (),
        assumption=Assumption(
            "no force linear in a strut's length",
            "a spring acts along a strut",
            "look for cables and hoses, or add `cable` and `force_offset` to the robot's `terms`: "
            "the stiffness becomes a parameter of the estimate",
        ),
        noun="a spring",
        absent="no force is linear in a strut's length (p = {p:.2g})",
        unit=lambda _: "N/m",
        values_shown=1,
        contains="force_offset",
    )


def _geometric_errors(effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield deviations of the geometry and of gravity's direction from the robot file."""
    has_motion = effects.motion is not None
    untested = MODELLED if has_motion else _POINTWISE
    joints = [
        tuple(f"{kind}_{axis}" for axis in "xyz")
        for kind in (*actuator_names("base_joint_"), *actuator_names("platform_joint_"))
    ]
    tilts, zeros = ("gravity_1", "gravity_2"), actuator_names("strut_length_")

    def columns(names: Sequence[str]) -> Signature:
        return effects.deviations(names) if has_motion else Signature.none(effects.part)

    yield Hypothesis(
        kind="joint",
        labels=tuple((end, j) for end in ("base", "platform") for j in range(ACTUATORS))
        if has_motion
        else (),
        columns=columns([name for joint in joints for name in joint]),
        places=tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(len(joints)))
        if has_motion
        else (),
        assumption=Assumption(
            "the joints are where the robot file says",
            "a joint is not at its position in the robot file",
            "measure it, or state the uncertainty of the joints, `tolerances.base_joints` and "
            "`tolerances.platform_joints`, with " + _JOINTLY,
        ),
        noun="a displaced joint",
        phrase="{place} displaced",
        absent="no joint is displaced (p = {p:.2g})",
        reason_untested=untested,
        scale=1e3,
        unit=lambda _: "mm",
    )
    yield Hypothesis(
        kind="gravity",
        labels=(("", None),) if has_motion else (),
        columns=columns(tilts),
        places=((0, 1),) if has_motion else (),
        assumption=Assumption(
            "gravity has the direction of the robot file",
            "gravity does not have the direction in the robot file",
            "level the base, or state its uncertainty, `tolerances.gravity`, with " + _JOINTLY,
        ),
        noun="a tilt of gravity",
        absent="gravity is not tilted (p = {p:.2g})",
        reason_untested=untested,
        scale=180 / np.pi,
        unit=lambda _: "deg",
    )
    yield Hypothesis(
        kind="length_zero",
        labels=_EACH if has_motion else (),
        columns=columns(zeros),
        assumption=Assumption(
            "lengths are measured from where the robot file says",
            "the zero of a length is wrong",
            "reference the strut again, or state the uncertainty of the zeros, "
            "`tolerances.strut_length`, with " + _JOINTLY,
        ),
        noun="a shifted zero of the length",
        absent="no zero of a length is wrong (p = {p:.2g})",
        reason_untested=untested,
        scale=1e3,
        unit=lambda _: "mm",
    )


def _delay(effects: CandidateEffects) -> Hypothesis:
    """Return the delay of the forces, by its secants."""
    step = effects.experiment.recording.step
    has_motion = effects.motion is not None
    seconds = tuple(steps * step for steps in _DELAYS) if has_motion else ()
    secants = [effects.delay(each) for each in seconds]
    return Hypothesis(
        kind="delay",
        labels=(("", None),) * len(seconds),
        columns=Signature.concatenate([Signature.none(effects.part), *secants]),
        constants=seconds,
        at=lambda _, seconds: effects.delay(seconds),
        sized_by_constant=True,
        assumption=Assumption(
            "forces and lengths are sampled at the same time",
            "the forces lag behind the lengths",
            "state the uncertainty of the delay, `tolerances.delay`, with "
            + _JOINTLY
            + "; a delay from the data sheet goes into `data.delay`",
        ),
        noun="a delay of the forces",
        absent="no significant delay of the forces ({value:.3g} ± {std:.1g} ms)",
        reason_untested="the forces do not change in time"
        if has_motion
        else "pointwise kinematics give no derivative of the forces in time",
        scale=1e3,
        number=".3g",
        unit=lambda _: "ms",
    )


def _inertia(effects: CandidateEffects) -> Hypothesis:
    """Return the inertia of motor and screw, which resists a strut's acceleration."""
    part = effects.part
    columns = Signature.none(part)
    if effects.lacks("drive_inertia"):
        along = effects.term("drive_inertia").forces
        columns = _all_and_each(Signature.of_forces(part, along * np.eye(ACTUATORS)))
    return Hypothesis(
        kind="drive_inertia",
        labels=_ALL_AND_EACH if columns.count else (),
        columns=columns,
        assumption=Assumption(
            "the drives have no unmodelled inertia",
            "the inertia of the drives is missing in the model",
            "state the `drive` in the robot file, a screw or gear with lead and inertia: its "
            "equivalent mass along the struts becomes a parameter of the estimate",
        ),
        noun="an inertia of the drives",
        absent="no drive has an unmodelled inertia (p = {p:.2g})",
        unit=lambda _: "kg",
    )


def _friction(effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield friction that depends on speed or on the load."""
    speeds = STRIBECK_VELOCITIES if effects.lacks("stribeck") else ()
    shapes = [_all_and_each(effects.term("stribeck", velocity=speed)) for speed in speeds]

    def of_speed(label: Label, speed: float) -> Signature:
        chosen = [_ALL_AND_EACH.index(label)]
        return _all_and_each(effects.term("stribeck", velocity=speed)).select(chosen)

    yield Hypothesis(
        kind="stribeck",
        labels=_ALL_AND_EACH * len(speeds),
        columns=Signature.concatenate([Signature.none(effects.part), *shapes]),
        constants=tuple(speed for speed in speeds for _ in _ALL_AND_EACH),
        at=of_speed,
        assumption=Assumption(
            "friction does not rise near standstill",
            "friction near standstill differs from the model",
            "add `stribeck`, with a `velocity` near this one, to the robot's `terms`: it becomes a "
            "parameter of the estimate, and so does the velocity with `estimate: true`",
        ),
        noun="friction near standstill",
        absent="friction near standstill agrees with the model (p = {p:.2g})",
        unit=lambda _: "N",
    )
    loaded = effects.missing_term("load_friction")
    loaded = _all_and_each(loaded) if loaded.count else loaded
    yield Hypothesis(
        kind="load_friction",
        labels=_ALL_AND_EACH if loaded.count else (),
        columns=loaded,
        assumption=Assumption(
            "friction does not depend on the load",
            "friction grows with the load of the actuators",
            "add `load_friction` to the robot's `terms`: it becomes a parameter of the estimate",
        ),
        noun="friction by load",
        absent="friction does not depend on the load (p = {p:.2g})",
        scale=100.0,
        unit=lambda _: "%",
    )


def _all_and_each(columns: Signature) -> Signature:
    """Return the sum of all columns, followed by the columns."""
    whole = Signature(
        np.sum(columns.forces, axis=2, keepdims=True),
        np.sum(columns.lengths, axis=2, keepdims=True),
    )
    return Signature.concatenate([whole, columns])


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


def hum_hypotheses(effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield the family of hums that contrasts between periods cancel, if there are any."""
    part, recording = effects.part, effects.experiment.recording
    hidden = hidden_hums(recording)
    if not hidden:
        return
    columns = []
    for _, multiple in hidden:
        angle = multiple * recording.omega * recording.forces.times
        pair = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        each = np.einsum("tp,ij->tijp", pair, np.eye(ACTUATORS))
        columns.append(part.cells.mean(each.reshape(len(angle), ACTUATORS, -1)))
    width = 2 * ACTUATORS
    yield Hypothesis(
        kind="hum",
        labels=tuple((f"of {frequency:g} Hz", None) for frequency, _ in hidden),
        columns=Signature.of_forces(part, np.concatenate(columns, axis=2)),
        places=tuple(tuple(range(k * width, (k + 1) * width)) for k in range(len(hidden))),
        assumption=Assumption(
            "no hum that repeats in every period",
            "the mains hum at a multiple of the motion's frequency",
            "earth and shield the measurement, or state the frequency in "
            "`noise.force_spectrum.hum` of the run and design again: the motion then avoids it",
        ),
        noun="a hum",
        absent="no hum of the mains at a multiple of the motion's frequency (p = {p:.2g})",
        reason_untested="the model's columns explain it",
        unit=lambda _: "N",
        paired=True,
    )
