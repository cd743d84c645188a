"""Information of the recordings on the parameters of candidate terms.

It follows from the joint regression of the diagnostics (`estimation.diagnostics.joint_system`):
whitened forces and lengths, one Gauss–Newton step in the parameters p, the deviations θ with
tolerances, and the motion ξ. The motion is eliminated for every recording; the remaining F and g of
(p, θ) are added over the recordings. They determine the decrease of −2 log L by any block of
columns given any others, so that thousands of models are compared without returning to the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Self

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.joint_system import (
    ConditionalScores,
    JointSystem,
    Places,
    RowWhitening,
    joint_systems,
)
from estimation.diagnostics.linearisation import CandidateEffects, Linearisation, linearise
from estimation.diagnostics.residual_covariance import empirical_noise, with_empirical_colour
from estimation.estimators import Experiment, ParameterPriors
from estimation.measurement_model.motion import Elimination, NormalEquations
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class InformationShare:
    """F, (u, u), and g, (u,), of some data: a step s lowers −2 log L by 2 gᵀs − sᵀ F s.

    Repeated data share one F and have one column of g each, (u, n).
    """

    information: Array
    gradient: Array

    def __add__(self, other: InformationShare) -> InformationShare:
        """Add the information of independent data."""
        return InformationShare(
            self.information + other.information, self.gradient + other.gradient
        )


@dataclass(frozen=True, eq=False)
class RecordingInformation:
    """Information of one recording on (p, θ)."""

    total: InformationShare
    columns: Array
    """(u,), zᵀ W z of the forces' columns, with the noise's own spectrum."""
    columns_white: Array
    """(u,), zᵀ W z under white noise of the same covariance."""
    samples: float
    """Number of single samples of the forces."""
    _system: JointSystem
    _elimination: Elimination
    _order: Places
    """Order of the system's unknowns: (p, θ), then the motion."""
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
        system = system.with_effects(candidate_effects.tolerance_columns()[0])
        unknowns = system.columns.shape[2]
        # (p, θ) first: the motion, which lies between them, is eliminated.
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
        total = InformationShare(reduced.information, reduced.gradient)
        return cls(
            total=total,
            columns=columns,
            columns_white=np.concatenate([np.sum(flat_white**2, axis=0), tolerated]),
            samples=float(np.sum(part.counts)),
            _system=system,
            _elimination=reduced,
            _order=order,
            _experiment=experiment,
        )

    def residual_chi_square(self, step: Array) -> tuple[float, int]:
        """Return χ² of the forces after a step of (p, θ), (u,), and the number of rows."""
        motion = self._elimination.offset - self._elimination.slope @ step
        whole = np.zeros(len(self._order))
        whole[self._order] = np.concatenate([step, motion])
        rest = self._system.forces - self._system.columns @ whole
        return float(np.sum(rest**2)), rest.size

    @cached_property
    def periods(self) -> Array:
        """(u, M), g of the single periods; their F is 1/M of the recording's.

        One column for all data if there are no separate periods.
        """
        experiment, system, size = self._experiment, self._system, len(self._order)
        forces, lengths = experiment.record.forces, experiment.record.lengths
        total = self.total.gradient[:, None]
        if forces.repeats is None or lengths.repeats is None:
            return total
        # All periods have the same columns and independent noise.
        count, first = len(forces.repeats), len(total)
        own = experiment.select_rows(np.moveaxis(forces.repeats - forces.values, 0, 2))
        gradients = system.columns.reshape(-1, size).T @ system.force_rows(own).reshape(-1, count)
        if len(system.lengths):
            own = np.moveaxis(lengths.repeats - lengths.values, 0, 2)
            rows = system.length_rows(own).reshape(-1, count)
            gradients += system.length_columns.reshape(-1, size).T @ rows
        gradients = gradients[self._order]
        slope = self._elimination.slope
        return np.asarray(total + gradients[:first] - slope.T @ gradients[first:]) / count


@dataclass(frozen=True, eq=False)
class Evidence:
    """Information of all recordings on (p, θ); p includes the candidates' parameters."""

    blocks: Mapping[str, Places]
    """Indices of each candidate's parameters in (p, θ)."""
    prior: InformationShare
    """Prior information on (p, θ)."""
    recordings: tuple[RecordingInformation, ...]
    freedom: float
    """Degrees of freedom of the noise's covariance; inf if it was given."""

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
            Priors of all its parameters.
        values : (m,)
            Parameters at which the model is linearised, SI.
        blocks : mapping
            Names of the parameters of each candidate.
        """
        shares, precision = [], np.zeros(0)
        reweighted = [_with_empirical_noise(experiment) for experiment in experiments]
        for experiment in reweighted:
            motion = None if experiment.fit is None else experiment.motion
            part = linearise(robot, experiment, values, priors.free, motion)
            candidate_effects = CandidateEffects(robot, experiment, motion, values, part)
            precision = candidate_effects.tolerance_columns()[1]
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
            min(each.noise.forces.weights_freedom for each in reweighted),
        )

    @cached_property
    def total(self) -> InformationShare:
        """Information of all recordings and the priors."""
        return reduce(
            InformationShare.__add__, (each.total for each in self.recordings), self.prior
        )

    @property
    def candidates(self) -> Places:
        """Indices of the parameters of all candidates."""
        return np.concatenate(list(self.blocks.values()))

    @property
    def own_terms(self) -> Places:
        """Indices of the unknowns that every model has."""
        return np.setdiff1d(np.arange(len(self.prior.gradient)), self.candidates)

    @cached_property
    def _reduced(self) -> Elimination:
        """Equations of the candidates, with all other unknowns eliminated."""
        total, order = self.total, np.concatenate([self.candidates, self.own_terms])
        matrix, gradient = total.information[np.ix_(order, order)], total.gradient[order]
        return NormalEquations(0.0, matrix, gradient).eliminated(len(self.candidates))

    def conditional_on_own_terms(self) -> ConditionalScores:
        """Return scores and information of the candidates given the robot's own terms.

        Raises
        ------
        numpy.linalg.LinAlgError
            The recordings do not determine the parameters of the robot's own terms.
        """
        reduced = self._reduced
        columns = np.sum([each.columns for each in self.recordings], axis=0)[self.candidates]
        return ConditionalScores(reduced.gradient, reduced.information, columns, self.freedom)

    def places(self, term: str) -> Places:
        """Return the indices of a candidate's parameters among those of all candidates."""
        return np.flatnonzero(np.isin(self.candidates, self.blocks[term]))

    def samples(self, term: str) -> float:
        """Return the number of independent samples with the same information on a candidate.

        It is the geometric mean over its parameters of zᵀ W z, divided by the mean information of
        a sample with white noise of the same covariance; with white noise, the number of samples.
        """
        at = self.blocks[term]
        actual = np.sum([each.columns[at] for each in self.recordings], axis=0)
        white = np.sum([each.columns_white[at] for each in self.recordings], axis=0)
        count = sum(each.samples for each in self.recordings)
        seen = white > 0
        if not np.any(seen):
            return count
        return float(np.exp(np.mean(np.log(count * actual[seen] / white[seen]))))

    def dispersion(self) -> float:
        """Return the residual variance of the largest model, relative to the noise; at least 1."""
        fit = self.conditional_on_own_terms().fit(np.arange(len(self.candidates)))
        step = np.zeros(len(self.prior.gradient))
        step[self.candidates] = fit.values
        step[self.own_terms] = self._reduced.offset - self._reduced.slope @ fit.values
        parts = [each.residual_chi_square(step) for each in self.recordings]
        chi_square, size = map(sum, zip(*parts, strict=True))
        return max(1.0, chi_square / (size - len(self.own_terms) - fit.rank))


def _with_empirical_noise(experiment: Experiment) -> Experiment:
    """Return an experiment with the noise and spectrum estimated from its periods."""
    coloured = with_empirical_colour(experiment)
    return replace(coloured, noise=empirical_noise(coloured))
