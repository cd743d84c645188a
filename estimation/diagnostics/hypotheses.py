"""The families of causes that residuals are searched for.

The regressor's own columns tell which parameter is wrong, and where. Held-out data: every column,
over all actuators. Data that were fitted have no score on the columns of the estimated parameters;
there, each column is tested in one actuator at a time, which finds a parameter that is not the same
in all struts, and the whole columns of parameters that were fixed. A common gain of all forces
scales all parameters and leaves nothing: it cannot be seen.

The other families are terms that the robot may lack, and deviations of the machine from its file.

Causes in the drives: an inertia that the model lacks, friction that depends on speed or load.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.candidate_effects import CandidateEffects
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.hypothesis import THERE, Hypothesis, Label
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.periodic_forces import hum_hypotheses
from estimation.diagnostics.significance import HYPOTHESES
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.hexapod import ACTUATORS, numbered

_DELAYS = (-3.0, -1.0, 0.1, 1.0, 3.0)
"""Delays whose secants are tried, in steps of the recording; the small one is a derivative."""

_EACH: tuple[Label, ...] = tuple(("", j) for j in range(ACTUATORS))
_POINTWISE = "pointwise kinematics have no motion that a deviation could move"
_JOINTLY = "`estimate.systematic: estimated`, which estimates it with everything else"


def list_hypotheses(
    candidate_effects: CandidateEffects,
    names: tuple[str, ...],
    *,
    held_out: bool,
    experiments: int = 1,
) -> tuple[Hypothesis, ...]:
    """Return the families that are tested; each of several experiments gets its share of a level.

    `names` are those of the regressor's columns; when `held_out`, the parameters were not estimated
    from these data.
    """
    own = parameter_hypothesis(candidate_effects.part, names, held_out=held_out)
    others = [
        *drive_hypotheses(candidate_effects),
        *_forces(candidate_effects),
        *_deviating(candidate_effects),
        _delay(candidate_effects),
        *hum_hypotheses(candidate_effects),
    ]
    # What is wrong with a prediction is most often a parameter, and so it is where some are fixed.
    stated = held_out or not np.all(candidate_effects.part.free)
    weights = np.ones(1 + len(others))
    weights[0] = len(others) if stated else 1.0
    levels = (HYPOTHESES / experiments * weights / np.sum(weights)).tolist()
    return tuple(
        replace(
            hypothesis,
            level=level,
            modelled=hypothesis.kind in term_definitions()
            and not candidate_effects.lacks(hypothesis.kind),
        )
        for hypothesis, level in zip((own, *others), levels, strict=True)
    )


def parameter_hypothesis(
    part: Linearisation, names: tuple[str, ...], *, held_out: bool
) -> Hypothesis:
    """Return the family of the regressor's own columns."""
    assumption = Assumption(
        "one value fits all struts",
        "a parameter is not the same in all struts, or was fixed at a wrong value",
        "free what was fixed (a fixed value that is wrong by a share looks like a common error of "
        "the force constants), or look for a fault in the struts named; the model has one value "
        "for all struts",
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
        level=HYPOTHESES,
        assumption=assumption,
        noun="another value of",
        absent="no parameter needs another value in one of the struts (p = {p:.2g})",
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


def _forces(candidate_effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield what is wrong in one actuator: its zero, its gain, a spring beside it."""
    part = candidate_effects.part
    nothing = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    offsets = (
        candidate_effects.term("force_offset")
        if candidate_effects.lacks("force_offset")
        else nothing
    )
    yield Hypothesis(
        kind="force_offset",
        labels=_EACH if offsets.count else (),
        columns=offsets,
        level=HYPOTHESES,
        assumption=Assumption(
            "no constant force in an actuator",
            "an actuator has a constant force that the model lacks",
            "add `force_offset` to the robot's `terms`: the offsets are estimated with everything "
            "else",
        ),
        noun="a constant force",
        absent="no actuator has a constant force beside the model (p = {p:.2g})",
        reason_untested=THERE,
        unit=lambda _: "N",
    )
    yield Hypothesis(
        kind="gain",
        labels=_EACH,
        columns=candidate_effects.gains(),
        level=HYPOTHESES,
        assumption=Assumption(
            "the forces have the same gain",
            "an actuator's force is measured with another gain than the others'",
            "state how well the force constants are known, `tolerances.force_constant.each`, with "
            + _JOINTLY,
        ),
        noun="a gain error",
        absent="no actuator's force has a gain of its own (p = {p:.2g})",
        reason_untested=THERE,
        scale=100.0,
        unit=lambda _: "%",
    )
    springs = nothing
    if candidate_effects.lacks("cable"):
        # Each with a constant force, since nobody knows its rest length.
        middle = np.mean(part.position, axis=0)
        stretch = (
            candidate_effects.term("cable", rest_length=0.0).forces - np.eye(ACTUATORS) * middle
        )
        constant = np.broadcast_to(np.eye(ACTUATORS), stretch.shape)
        springs = Signature.of_forces(part, np.concatenate([stretch, constant], axis=2))
    yield Hypothesis(
        kind="cable",
        labels=_EACH if springs.count else (),
        columns=springs,
        places=tuple((j, ACTUATORS + j) for j in range(ACTUATORS)) if springs.count else (),
        level=HYPOTHESES,
        assumption=Assumption(
            "no force linear in a strut's length",
            "something springs along a strut",
            "look for cables and hoses, or add `cable` and `force_offset` to the robot's `terms`: "
            "the stiffness is estimated with everything else",
        ),
        noun="a spring",
        absent="no force is linear in a strut's length (p = {p:.2g})",
        reason_untested=THERE,
        unit=lambda _: "N/m",
        values_shown=1,
        contains="force_offset",
    )


def _deviating(candidate_effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield what the geometry, or gravity's direction, has otherwise than the robot file says."""
    part = candidate_effects.part
    nothing = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    moved = candidate_effects.motion is not None
    joints = [
        tuple(f"{kind}_{axis}" for axis in "xyz")
        for kind in (*numbered("base_joint_"), *numbered("platform_joint_"))
    ]
    tilts, zeros = ("gravity_1", "gravity_2"), numbered("strut_length_")

    def columns(names: Sequence[str]) -> Signature:
        return candidate_effects.deviations(names) if moved else nothing

    yield Hypothesis(
        kind="joint",
        labels=tuple((end, j) for end in ("base", "platform") for j in range(ACTUATORS))
        if moved
        else (),
        columns=columns([name for joint in joints for name in joint]),
        places=tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(len(joints))) if moved else (),
        level=HYPOTHESES,
        assumption=Assumption(
            "the joints are where the robot file says",
            "a joint is not where the robot file says",
            "measure it, or state how well joints are known, `tolerances.base_joints` and "
            "`tolerances.platform_joints`, with " + _JOINTLY,
        ),
        noun="a joint elsewhere",
        phrase="{place} elsewhere",
        absent="no joint is elsewhere (p = {p:.2g})",
        reason_untested=THERE if moved else _POINTWISE,
        scale=1e3,
        unit=lambda _: "mm",
    )
    yield Hypothesis(
        kind="gravity",
        labels=(("", None),) if moved else (),
        columns=columns(tilts),
        places=((0, 1),) if moved else (),
        level=HYPOTHESES,
        assumption=Assumption(
            "gravity has the direction of the robot file",
            "gravity has another direction than the robot file says",
            "level the base, or state how well it is level, `tolerances.gravity`, with " + _JOINTLY,
        ),
        noun="a tilt of gravity",
        absent="gravity is not tilted (p = {p:.2g})",
        reason_untested=THERE if moved else _POINTWISE,
        scale=180 / np.pi,
        unit=lambda _: "deg",
    )
    yield Hypothesis(
        kind="length_zero",
        labels=_EACH if moved else (),
        columns=columns(zeros),
        level=HYPOTHESES,
        assumption=Assumption(
            "lengths are measured from where the robot file says",
            "the zero of a length is off",
            "reference the strut again, or state how well the zeros are known, "
            "`tolerances.strut_length`, with " + _JOINTLY,
        ),
        noun="a shifted zero of the length",
        absent="no zero of a length is off (p = {p:.2g})",
        reason_untested=THERE if moved else _POINTWISE,
        scale=1e3,
        unit=lambda _: "mm",
    )


def _delay(candidate_effects: CandidateEffects) -> Hypothesis:
    part, step = candidate_effects.part, candidate_effects.experiment.record.step
    moved = candidate_effects.motion is not None
    seconds = tuple(steps * step for steps in _DELAYS) if moved else ()
    secants = [candidate_effects.delay(each) for each in seconds]
    return Hypothesis(
        kind="delay",
        labels=(("", None),) * len(seconds),
        columns=Signature.joined(
            [Signature.of_forces(part, np.zeros((*part.forces.shape, 0))), *secants]
        ),
        constants=seconds,
        at=lambda _, seconds: candidate_effects.delay(seconds),
        sized_by_constant=True,
        level=HYPOTHESES,
        assumption=Assumption(
            "forces and lengths are sampled at the same time",
            "the forces lag behind the lengths",
            "state how well the delay is known, `tolerances.delay`, with "
            + _JOINTLY
            + "; a delay from the data sheet goes into `data.delay`",
        ),
        noun="a delay of the forces",
        absent="no delay of the forces is seen ({value:.3g} ± {std:.1g} ms)",
        reason_untested="the forces do not change in time"
        if moved
        else "pointwise kinematics give no derivative of the forces in time",
        scale=1e3,
        number=".3g",
        unit=lambda _: "ms",
    )


STRIBECK_VELOCITIES = (0.02, 0.05, 0.12)
"""Speeds at which friction beyond the dry one is tried, m/s: neighbours overlap."""

_ALL_AND_EACH: tuple[Label, ...] = (("", None), *(("", j) for j in range(ACTUATORS)))


def drive_hypotheses(candidate_effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield the families: inertia, friction near standstill, friction by load."""
    yield _inertia(candidate_effects)
    yield from _friction(candidate_effects)


def _inertia(candidate_effects: CandidateEffects) -> Hypothesis:
    """Return what resists the acceleration of a strut: a motor and its screw."""
    part = candidate_effects.part
    columns = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    if candidate_effects.lacks("drive_inertia"):
        along = candidate_effects.term("drive_inertia").forces
        columns = _all_and_each(Signature.of_forces(part, along * np.eye(ACTUATORS)))
    return Hypothesis(
        kind="drive_inertia",
        labels=_ALL_AND_EACH if columns.count else (),
        columns=columns,
        level=HYPOTHESES,
        assumption=Assumption(
            "the drives have no inertia beside the model",
            "the inertia of the drives is missing in the model",
            "state the `drive` in the robot file, a screw or gear with lead and inertia: the mass "
            "that it makes along the struts is estimated with everything else",
        ),
        noun="an inertia of the drives",
        absent="no drive has an inertia beside the model (p = {p:.2g})",
        reason_untested=THERE,
        unit=lambda _: "kg",
    )


def _friction(candidate_effects: CandidateEffects) -> Iterator[Hypothesis]:
    """Yield friction that depends on speed, or on the load."""
    part = candidate_effects.part
    nothing = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    speeds = STRIBECK_VELOCITIES if candidate_effects.lacks("stribeck") else ()
    shapes = [_all_and_each(candidate_effects.term("stribeck", velocity=speed)) for speed in speeds]

    def of_speed(label: Label, speed: float) -> Signature:
        chosen = [_ALL_AND_EACH.index(label)]
        return _all_and_each(candidate_effects.term("stribeck", velocity=speed)).picked(chosen)

    yield Hypothesis(
        kind="stribeck",
        labels=_ALL_AND_EACH * len(speeds),
        columns=Signature.joined([nothing, *shapes]),
        constants=tuple(speed for speed in speeds for _ in _ALL_AND_EACH),
        at=of_speed,
        level=HYPOTHESES,
        assumption=Assumption(
            "friction does not rise near standstill",
            "friction near standstill is not that of the model",
            "add `stribeck`, with a `velocity` like the one named, to the robot's `terms`: it is "
            "estimated with everything else, and so is the velocity with `estimate: true`",
        ),
        noun="friction near standstill",
        absent="friction near standstill is that of the model (p = {p:.2g})",
        reason_untested=THERE,
        unit=lambda _: "N",
    )
    loaded = (
        _all_and_each(candidate_effects.term("load_friction"))
        if candidate_effects.lacks("load_friction")
        else nothing
    )
    yield Hypothesis(
        kind="load_friction",
        labels=_ALL_AND_EACH if loaded.count else (),
        columns=loaded,
        level=HYPOTHESES,
        assumption=Assumption(
            "friction does not depend on the load",
            "friction grows with the load of the actuators",
            "add `load_friction` to the robot's `terms`: it is estimated with everything else",
        ),
        noun="friction by load",
        absent="friction does not depend on the load (p = {p:.2g})",
        reason_untested=THERE,
        scale=100.0,
        unit=lambda _: "%",
    )


def _all_and_each(columns: Signature) -> Signature:
    """Return the sum of all columns, and the columns."""
    whole = Signature(
        np.sum(columns.forces, axis=2, keepdims=True),
        np.sum(columns.lengths, axis=2, keepdims=True),
    )
    return Signature.joined([whole, columns])
