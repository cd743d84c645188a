"""Columns of candidate effects: terms of the catalogue, deviations of the machine, a delay.

The columns are evaluated at the estimate, along the estimated motion, and averaged over the same
cells as the residuals. Quantities that depend on the parameters, such as the load of the actuators,
are those of the estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.estimators.experiment import Experiment, regressors_along, regressors_at
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.prediction import deviation_forces, deviation_lengths
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Term, parameters_of
from expdesign.robot import Robot
from expdesign.robot.deviation import (
    Deviation,
    deviations,
    estimated_constants,
    toleranced_deviations,
)

CANDIDATE_TERMS = ("load_friction", "drive_inertia", "stribeck", "force_offset", "cable")
"""Terms of the catalogue that a robot may lack; the load-dependent one comes first, so that the
load is that of the robot's own terms."""
_GEOMETRIC = ("base_joints", "platform_joints", "gravity", "strut_length")


@dataclass(frozen=True, eq=False)
class CandidateEffects:
    """Point at which the columns of candidate effects are evaluated."""

    robot: Robot
    experiment: Experiment
    motion: HarmonicMotion | None
    """Estimated motion; None: the pointwise motion of the experiment."""
    values: Array
    """(m,), estimated parameters, SI."""
    part: Linearisation

    def gains(self) -> Signature:
        """Return the columns of the six gains: predicted force of one actuator each, N."""
        forces = self.part.regressors @ self.values
        return self._of_forces(forces[:, :, None] * np.eye(ACTUATORS))

    def lacks(self, name: str) -> bool:
        """Return whether the robot does not have a term of the catalogue."""
        return name not in {term.name for term in self.robot.terms}

    def term(self, name: str, **constants: float) -> Signature:
        """Return the columns of a term that the robot lacks, with its constants, SI."""
        if tuple(constants) != tuple(
            constant.name for constant in term_definitions()[name].constants
        ):
            raise ValueError(f"{name} has other constants than {', '.join(constants)}")
        robot, signs = self._extended
        first = 0
        held: list[float] = []
        for term in robot.terms:
            own = len(term.constants)
            known = robot.description.constants[first : first + own]
            held += constants.values() if term.name == name else known
            first += own
        changed = Robot(replace(robot.description, constants=tuple(held)), robot.load_parameters)
        regressors = self._regressors(changed, signs)
        columns = slice(*_columns_of(robot.terms, name))
        return self._of_forces(self.part.cells.mean(regressors[:, :, columns]))

    def missing_term(self, name: str) -> Signature:
        """Return the columns of a term without constants, if the robot lacks it; otherwise none."""
        return self.term(name) if self.lacks(name) else Signature.none(self.part)

    def deviations(self, names: Sequence[str]) -> Signature:
        """Return the columns of `expdesign.robot.deviation` with these names."""
        picked = [self._deviations[1].index(name) for name in names]
        return self._deviations[0].select(picked)

    def tolerance_columns(self) -> tuple[Signature, Array]:
        """Return the columns of all deviations with a tolerance, and their 1/std², (t,).

        They include estimated constants of terms. There are none after pointwise kinematics.
        """
        entries = self._inexact if self.motion is not None else ()
        if not entries:
            return Signature.none(self.part), np.zeros(0)
        precision = np.array([each.std**-2 for each in entries])
        return self.deviations([each.name for each in entries]), precision

    @cached_property
    def _inexact(self) -> tuple[Deviation, ...]:
        constants = estimated_constants(self.robot)
        names = {one.name for one in constants}
        others = (one for one in toleranced_deviations(self.robot) if one.name not in names)
        return (*constants, *others)

    def delay(self, seconds: float) -> Signature:
        """Return the change of the forces due to a delay, N per second of delay.

        It is a secant, not a derivative, so that jumps of dry friction are delayed as well.
        """
        if self.motion is None:
            raise ValueError("pointwise kinematics cannot be shifted in time")
        change = (self._forces(self.motion.delayed(seconds)) - self._forces_in_time) / seconds
        return self._of_forces(self.part.cells.mean(change)[:, :, None])

    @cached_property
    def _forces_in_time(self) -> Array:
        if self.motion is None:
            raise ValueError("pointwise kinematics cannot be shifted in time")
        return self._forces(self.motion)

    def _forces(self, motion: HarmonicMotion) -> Array:
        """Return the predicted forces at the samples along a motion, (T, 6)."""
        signs = self.experiment.signs(self.robot, motion)
        return regressors_along(self.robot, motion, self.experiment.times, signs) @ self.values

    @cached_property
    def _deviations(self) -> tuple[Signature, tuple[str, ...]]:
        robot, experiment, motion, part = self.robot, self.experiment, self.motion, self.part
        if motion is None:
            raise ValueError("pointwise kinematics have no motion model for deviations")
        inexact = {each.name for each in self._inexact}
        wanted = [
            each for each in deviations(robot) if each.group in _GEOMETRIC or each.name in inexact
        ]
        signs = experiment.signs(robot, motion)
        own_clock = experiment.record.own_clock
        forces = deviation_forces(
            robot, motion, experiment.times, signs, self.values, wanted, own_clock=own_clock
        )
        times = experiment.record.lengths.times
        lengths = deviation_lengths(robot, motion, times, wanted, own_clock=own_clock)
        columns = Signature(part.cells.mean(forces), part.length_cells.mean(lengths))
        return columns, tuple(each.name for each in wanted)

    def _of_forces(self, columns: Array) -> Signature:
        return Signature.of_forces(self.part, columns)

    @cached_property
    def _extended(self) -> tuple[Robot, Array | None]:
        """Robot with its frictionless terms and all candidate terms, and the signs of friction.

        Its load is that of the estimate. The expected signs are (T, s); None after pointwise
        kinematics, which use the exact ones.
        """
        about, experiment, motion = self.robot.description, self.experiment, self.motion
        own = iter(about.constants)
        constants = {term: [next(own) for _ in term.constants] for term in about.terms}
        held = tuple(term for term in about.terms if not term.rates)
        terms = (*held, *(term_definitions()[name] for name in CANDIDATE_TERMS if self.lacks(name)))
        values = dict(zip(self.robot.parameter_names, self.values.tolist(), strict=True))
        parameters = {p.name: values.get(p.name, 0.0) for p in parameters_of(terms)}
        robot = Robot(
            replace(
                about,
                terms=terms,
                constants=tuple(
                    value
                    for term in terms
                    for value in constants.get(term, [1.0] * len(term.constants))
                ),
                parameters=parameters,
            )
        )
        if motion is None or experiment.fit is None:
            return robot, None
        times = experiment.record.forces.times
        if not robot.graph.rates:
            return robot, np.zeros((len(times), 0))
        return robot, experiment.signs_for_robot(robot, motion)

    def _regressors(self, robot: Robot, signs: Array | None) -> Array:
        """Return the regressors of another robot at the samples, (T, 6, m)."""
        if self.motion is not None and signs is not None:
            return regressors_along(robot, self.motion, self.experiment.record.forces.times, signs)
        if self.experiment.pointwise is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        return regressors_at(robot, self.experiment.pointwise)


def _columns_of(terms: Sequence[Term], name: str) -> tuple[int, int]:
    """Return the first column of a term, and the one after its last."""
    names = [term.name for term in terms]
    place = names.index(name)
    first = len(parameters_of(tuple(terms[:place])))
    return first, first + len(terms[place].parameters)
