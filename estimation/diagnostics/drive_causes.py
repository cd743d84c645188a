"""Causes in the drives: an inertia that the model lacks, friction that depends on speed or load."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimation.diagnostics.cause import THERE, Cause, Label
from estimation.diagnostics.channel_test import CAUSES
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.signature import Signature
from estimation.diagnostics.suspects import Suspects
from expdesign.mechanism.hexapod import ACTUATORS

STRIBECK_VELOCITIES = (0.02, 0.05, 0.12)
"""Speeds at which friction beyond the dry one is tried, m/s: neighbours overlap."""

_ALL_AND_EACH: tuple[Label, ...] = (("", None), *(("", j) for j in range(ACTUATORS)))


def drive_causes(suspects: Suspects) -> Iterator[Cause]:
    """Yield the families: inertia, friction near standstill, friction by load."""
    yield _inertia(suspects)
    yield from _friction(suspects)


def _inertia(suspects: Suspects) -> Cause:
    """Return what resists the acceleration of a strut: a motor and its screw."""
    part = suspects.part
    columns = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    if suspects.lacks("drive_inertia"):
        along = suspects.term("drive_inertia").forces
        columns = _all_and_each(Signature.of_forces(part, along * np.eye(ACTUATORS)))
    return Cause(
        kind="drive_inertia",
        labels=_ALL_AND_EACH if columns.count else (),
        columns=columns,
        level=CAUSES,
        assumption=Assumption(
            "the drives have no inertia beside the model",
            "the inertia of the drives is missing in the model",
            "state the `drive` in the robot file, a screw or gear with lead and inertia: the mass "
            "that it makes along the struts is estimated with everything else",
        ),
        noun="an inertia of the drives",
        absent="no drive has an inertia beside the model (p = {p:.2g})",
        untested=THERE,
        unit=lambda _: "kg",
    )


def _friction(suspects: Suspects) -> Iterator[Cause]:
    """Yield friction that depends on speed, or on the load."""
    part = suspects.part
    nothing = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
    speeds = STRIBECK_VELOCITIES if suspects.lacks("stribeck") else ()
    shapes = [_all_and_each(suspects.term("stribeck", velocity=speed)) for speed in speeds]

    def of_speed(label: Label, speed: float) -> Signature:
        chosen = [_ALL_AND_EACH.index(label)]
        return _all_and_each(suspects.term("stribeck", velocity=speed)).picked(chosen)

    yield Cause(
        kind="stribeck",
        labels=_ALL_AND_EACH * len(speeds),
        columns=Signature.joined([nothing, *shapes]),
        constants=tuple(speed for speed in speeds for _ in _ALL_AND_EACH),
        at=of_speed,
        level=CAUSES,
        assumption=Assumption(
            "friction does not rise near standstill",
            "friction near standstill is not that of the model",
            "add `stribeck`, with a `velocity` like the one named, to the robot's `terms`: it is "
            "estimated with everything else, and so is the velocity with `estimate: true`",
        ),
        noun="friction near standstill",
        absent="friction near standstill is that of the model (p = {p:.2g})",
        untested=THERE,
        unit=lambda _: "N",
    )
    loaded = (
        _all_and_each(suspects.term("load_friction"))
        if suspects.lacks("load_friction")
        else nothing
    )
    yield Cause(
        kind="load_friction",
        labels=_ALL_AND_EACH if loaded.count else (),
        columns=loaded,
        level=CAUSES,
        assumption=Assumption(
            "friction does not depend on the load",
            "friction grows with the load of the actuators",
            "add `load_friction` to the robot's `terms`: it is estimated with everything else",
        ),
        noun="friction by load",
        absent="friction does not depend on the load (p = {p:.2g})",
        untested=THERE,
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
