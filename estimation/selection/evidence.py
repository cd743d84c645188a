"""What recordings say of the parameters of candidates, beside those of the robot's own terms.

Everything is in the joint regression of the diagnostics (`estimation.diagnostics.joint_system`):
forces and lengths behind the filters that make their noise white, one Gauss–Newton step in the
parameters p, what is known within tolerances θ, and the motion ξ. The motion of every recording is
eliminated by itself; what is left, F and g of (p, θ), is added over the recordings. The χ² by which
a block of columns lowers −2 log L beside any others follows from F and g alone, so that thousands
of models are compared without going back to the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Self

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.candidate_effects import CandidateEffects
from estimation.diagnostics.joint_system import (
    ConditionalScores,
    JointSystem,
    Places,
    RowWhitening,
    joint_systems,
)
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.residual_covariance import empirical_noise, with_empirical_colour
from estimation.estimators import Experiment, ParameterPriors
from estimation.measurement_model.normal_equations import Elimination, NormalEquations
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class InformationShare:
    """F, (u, u), and g, (u,), of some of the data: −2 log L falls by 2 gᵀs − sᵀ F s.

    Data that are alike have one F, and the columns of g each its own, (u, n).
    """

    information: Array
    gradient: Array

    def __add__(self, other: InformationShare) -> InformationShare:
        """Return what both say."""
        return InformationShare(
            self.information + other.information, self.gradient + other.gradient
        )


@dataclass(frozen=True, eq=False)
class RecordingInformation:
    """What one recording says of (p, θ)."""

    whole: InformationShare
    columns: Array
    """(u,), zᵀ W z of the forces' columns, with the noise's own spectrum."""
    columns_white: Array
    """(u,), the same for white noise of the same covariance."""
    samples: float
    """Single samples of the forces."""
    _system: JointSystem
    _elimination: Elimination
    _order: Places
    """Of the system's unknowns: (p, θ), then the motion."""
    _experiment: Experiment

    @classmethod
    def of(
        cls, candidate_effects: CandidateEffects, part: Linearisation, experiment: Experiment
    ) -> Self:
        """Linearise one recording and eliminate its motion."""
        count = int(np.count_nonzero(part.free))
        nothing = np.zeros((count, count)), np.zeros(count)
        (system,) = joint_systems([part], [experiment.noise], nothing, held_out=False)
        motion = system.columns.shape[2] - count
        system = system.with_effects(candidate_effects.tolerated()[0])
        unknowns = system.columns.shape[2]
        # (p, θ) first: the motion, which stands between them, is eliminated.
        kept = np.r_[0:count, count + motion : unknowns]
        order = np.r_[kept, count : count + motion]
        flat = system.columns.reshape(-1, unknowns)
        gradient = flat.T @ system.forces.ravel() + system.gradient
        matrix = flat.T @ flat
        columns = np.diag(matrix)[kept]
        matrix = (matrix + system.information)[np.ix_(order, order)]
        reduced = NormalEquations(0.0, matrix, gradient[order]).eliminated(len(kept))
        white = RowWhitening.of(experiment.noise.forces.taken_for_white(), part.counts)
        tolerated = np.zeros(len(kept) - count)
        flat_white = white(part.regressors[:, :, part.free]).reshape(-1, count)
        whole = InformationShare(reduced.information, reduced.gradient)
        return cls(
            whole=whole,
            columns=columns,
            columns_white=np.concatenate([np.sum(flat_white**2, axis=0), tolerated]),
            samples=float(np.sum(part.counts)),
            _system=system,
            _elimination=reduced,
            _order=order,
            _experiment=experiment,
        )

    def left(self, step: Array) -> tuple[float, int]:
        """Return χ² of the forces after a step of (p, θ), (u,), and how many numbers they are."""
        motion = self._elimination.offset - self._elimination.slope @ step
        whole = np.zeros(len(self._order))
        whole[self._order] = np.concatenate([step, motion])
        rest = self._system.forces - self._system.columns @ whole
        return float(np.sum(rest**2)), rest.size

    @cached_property
    def periods(self) -> Array:
        """(u, M), g of the single periods, whose F is the M-th part of the recording's.

        One column, of all data, where single periods are not known.
        """
        experiment, system, size = self._experiment, self._system, len(self._order)
        forces, lengths = experiment.record.forces, experiment.record.lengths
        whole = self.whole.gradient[:, None]
        if forces.repeats is None or lengths.repeats is None:
            return whole
        # All have the same columns, and each its own noise.
        count, first = len(forces.repeats), len(whole)
        own = experiment.select_rows(np.moveaxis(forces.repeats - forces.values, 0, 2))
        gradients = system.columns.reshape(-1, size).T @ system.force_rows(own).reshape(-1, count)
        if len(system.lengths):
            own = np.moveaxis(lengths.repeats - lengths.values, 0, 2)
            rows = system.length_rows(own).reshape(-1, count)
            gradients += system.length_columns.reshape(-1, size).T @ rows
        gradients = gradients[self._order]
        slope = self._elimination.slope
        return np.asarray(whole + gradients[:first] - slope.T @ gradients[first:]) / count


@dataclass(frozen=True, eq=False)
class Evidence:
    """What all recordings say of (p, θ), the candidates' parameters among p."""

    blocks: Mapping[str, Places]
    """Places of the parameters of each candidate among (p, θ)."""
    prior: InformationShare
    """What is known of (p, θ) beside the recordings."""
    recordings: tuple[RecordingInformation, ...]
    freedom: float
    """Degrees of freedom behind the noise; inf where it was given."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        experiments: Sequence[Experiment],
        priors: ParameterPriors,
        values: Array,
        blocks: Mapping[str, tuple[str, ...]],
    ) -> Self:
        """Linearise the recordings.

        Parameters
        ----------
        robot : Robot
            With all candidates among its terms.
        priors : ParameterPriors
            Of all its parameters.
        values : (m,)
            Parameters about which the model is linearised, SI.
        blocks : mapping
            Names of the parameters of each candidate.
        """
        shares, precision = [], np.zeros(0)
        seen = [_as_shown(experiment) for experiment in experiments]
        for experiment in seen:
            motion = None if experiment.fit is None else experiment.motion
            part = linearise(robot, experiment, values, priors.free, motion)
            candidate_effects = CandidateEffects(robot, experiment, motion, values, part)
            precision = candidate_effects.tolerated()[1]
            shares.append(RecordingInformation.of(candidate_effects, part, experiment))
        names = [n for n, free in zip(priors.names, priors.free, strict=True) if free]
        size = len(names) + len(precision)
        information = np.zeros((size, size))
        information[: len(names), : len(names)] = priors.precision
        behind = np.arange(len(names), size)
        information[behind, behind] = precision
        off = np.zeros(size)
        off[: len(names)] = (priors.prior_mean - values)[priors.free]
        return cls(
            {
                term: np.array([names.index(name) for name in own], dtype=np.intp)
                for term, own in blocks.items()
            },
            InformationShare(information, information @ off),
            tuple(shares),
            min(each.noise.forces.weights_freedom for each in seen),
        )

    @cached_property
    def whole(self) -> InformationShare:
        """All recordings, with what is known beside them."""
        return reduce(
            InformationShare.__add__, (each.whole for each in self.recordings), self.prior
        )

    @property
    def candidates(self) -> Places:
        """Places of all parameters of candidates."""
        return np.concatenate(list(self.blocks.values()))

    @property
    def own(self) -> Places:
        """Places of what every model has."""
        return np.setdiff1d(np.arange(len(self.prior.gradient)), self.candidates)

    @cached_property
    def _reduced(self) -> Elimination:
        """The equations of the candidates, with all else eliminated."""
        whole, order = self.whole, np.concatenate([self.candidates, self.own])
        matrix, gradient = whole.information[np.ix_(order, order)], whole.gradient[order]
        return NormalEquations(0.0, matrix, gradient).eliminated(len(self.candidates))

    def conditional_on_own_terms(self) -> ConditionalScores:
        """Return what is seen of the candidates beside the robot's own terms.

        Raises
        ------
        numpy.linalg.LinAlgError
            The recordings do not determine the parameters of the robot's own terms.
        """
        reduced = self._reduced
        columns = np.sum([each.columns for each in self.recordings], axis=0)[self.candidates]
        return ConditionalScores(reduced.gradient, reduced.information, columns, self.freedom)

    def places(self, term: str) -> Places:
        """Return the places of a candidate's parameters among those of all candidates."""
        return np.flatnonzero(np.isin(self.candidates, self.blocks[term]))

    def samples(self, term: str) -> float:
        """Return the number n of independent samples that tell as much of a candidate.

        The geometric mean over its parameters of zᵀ W z by what a single sample, of white noise
        with the same covariance, tells on average: all samples where the noise is white.
        """
        at = self.blocks[term]
        known = np.sum([each.columns[at] for each in self.recordings], axis=0)
        white = np.sum([each.columns_white[at] for each in self.recordings], axis=0)
        count = sum(each.samples for each in self.recordings)
        seen = white > 0
        if not np.any(seen):
            return count
        return float(np.exp(np.mean(np.log(count * known[seen] / white[seen]))))

    def dispersion(self) -> float:
        """Return how many times the noise the largest model leaves of the forces; 1 at least."""
        fit = self.conditional_on_own_terms().fit(np.arange(len(self.candidates)))
        step = np.zeros(len(self.prior.gradient))
        step[self.candidates] = fit.values
        step[self.own] = self._reduced.offset - self._reduced.slope @ fit.values
        left, size = map(sum, zip(*(each.left(step) for each in self.recordings), strict=True))
        return max(1.0, left / (size - len(self.own) - fit.rank))


def _as_shown(experiment: Experiment) -> Experiment:
    """Return an experiment with the noise that its periods show, with its spectrum."""
    remembered = with_empirical_colour(experiment)
    return replace(remembered, noise=empirical_noise(remembered))
