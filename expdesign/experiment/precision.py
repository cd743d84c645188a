"""The predicted precision of a design: random errors by noise, systematic ones by tolerances.

The systematic errors follow from the sensitivity of the estimate. The Gauss–Markov estimate takes
the motion from the lengths, as a series. For a machine with deviations θ the lengths yield another
motion, and the forces other parameters: with L = ∂l/∂ξ

    ∂ξ̂/∂θ = (Σ Lᵀ Δ⁻¹ L)⁻¹ Σ Lᵀ Δ⁻¹ Z_l,
    D = F⁻¹ Σ Aᵀ Σ⁻¹ (Z_f − ∂(A p)/∂ξ · ∂ξ̂/∂θ).

The series has the harmonics of the design, and those that θ raises above the noise of the lengths:
the estimate takes them for motion, and D grows by up to a half. With θ estimated by
maximum likelihood and its tolerances Θ as priors the columns U = Z_f − ∂(A p)/∂ξ · ∂ξ̂/∂θ are
further columns of A: with F of [A | U] over all samples

    C = (F + Θ⁻¹)⁻¹,   D = −C_pθ Θ⁻¹,

and C_pp is the total covariance. For both estimators it is within 1 % of the estimate's own.

For a change π since an identification with the same tolerances and the error D₀ θ of its parameters
the common part of both errors cancels: with S and R of `expdesign.information.marginal`

    D = S⁻¹ Rᵀ (Σ Aᵀ Σ⁻¹ (Z_f − …) − F D₀).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.configuration.schema import MOST_SAMPLES
from expdesign.experiment import result
from expdesign.experiment.judging import (
    earlier_recordings,
    inexact_deviations,
    noise_evaluator,
)
from expdesign.information import fisher
from expdesign.information.identifiable import (
    IDENTIFIABLE,
    BaseParameters,
    KnownCombination,
    identified_base,
    known_combinations,
    listed,
    root_of,
    root_of_inverse,
)
from expdesign.information.marginal import Marginal
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.terms import parameter_unit
from expdesign.noise import NoiseSpectrum
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.followed_lengths import (
    Noise,
    RecordedNoise,
    raised_harmonics,
    sampled_harmonics,
)
from expdesign.robot import Robot, deviation
from expdesign.robot.derived import (
    NOISE,
    ErrorShares,
    KnownQuantity,
    belongs_to,
    derived_quantities,
    known_quantities,
)
from expdesign.trajectory import FourierTrajectory, PhaseBasis

_WHOLE = 1e-6
_NEARLY = 10.0
"""Standard deviations over the identifiable ones that a hundred times the periods make up for."""
_UNSEEN = 1e-12
"""Information on inexact quantities, relative to the largest, that is a rounding error."""


def experiment_information(
    evaluator: Evaluator, trajectory: FourierTrajectory, configuration: RunConfiguration
) -> tuple[Array, int]:
    """Return F of the whole experiment with all of the prior, (k, k), and its samples."""
    experiment = configuration.run.experiment
    per_period = trajectory.period * experiment.sampling
    total = int(np.ceil(experiment.periods * per_period * (1 - 1e-12)))
    count = whole(per_period)
    if count is not None:
        information = evaluator.whole_information(trajectory, count) * experiment.periods
    elif evaluator.memory is not None or total > MOST_SAMPLES:
        # The information of a period with nearly as many samples, for all of them.
        count = max(1, round(per_period))
        information = evaluator.whole_information(trajectory, count) * (total / count)
    else:
        motion = trajectory.sample(np.arange(total) / experiment.sampling)
        information = evaluator.of_regressors(evaluator.robot.regressor(*motion), trajectory.omega)
    return evaluator.judged(information), total


def precision(
    evaluator: Evaluator, information: Array, samples: int, periods: float
) -> result.PredictedPrecision:
    """Return the standard deviations of F, (k, k), over so many samples and periods."""
    std = np.sqrt(np.diag(fisher.parameter_covariance(information, evaluator.names)))
    named = dict(zip(evaluator.names, std.tolist(), strict=True))
    return result.PredictedPrecision(samples, periods, named)


def predicted_errors(
    configuration: RunConfiguration,
    evaluator: Evaluator,
    trajectory: FourierTrajectory,
    information: Array,
    samples: int,
) -> ErrorShares:
    """Return the errors of the judged parameters, k, in the whole experiment, by source.

    `information`, (k, k), is its F over so many samples.
    """
    effects = experiment_tolerance_effects(configuration, evaluator, trajectory)
    random = fisher.parameter_covariance(information, evaluator.names)
    return effects.shares(
        random, samples, estimated=configuration.run.estimate.estimates_tolerances
    )


def experiment_tolerance_effects(
    configuration: RunConfiguration, evaluator: Evaluator, trajectory: FourierTrajectory
) -> ToleranceEffects:
    """Return the effects of the robot's tolerances on the judged parameters of a motion."""
    noise, design = configuration.robot.noise, configuration.run.design
    harmonics = _estimated_harmonics(configuration, evaluator.robot, trajectory)
    found = tolerance_effects(
        evaluator,
        trajectory,
        max(configuration.run.trajectory.samples, 4 * harmonics + 1),
        None if noise is None else noise.length_covariance,
        harmonics,
        change=evaluator.marginal if design.is_change else None,
    )
    if design.prior is None or design.is_change:
        return found
    chosen = inexact_deviations(configuration, evaluator.robot)
    own = deviation.toleranced_deviations(evaluator.robot)
    factors = [one.tolerance / other.tolerance for one, other in zip(chosen, own, strict=True)]
    earlier = earlier_recordings(configuration, evaluator.names, chosen)
    units = np.append(np.ones(len(evaluator.names)), [one.tolerance for one in chosen])
    in_units = None if earlier is None else earlier * np.multiply.outer(units, units)
    return replace(found.rescaled(np.array(factors)), earlier=in_units)


def _estimated_harmonics(
    configuration: RunConfiguration, robot: Robot, trajectory: FourierTrajectory
) -> int:
    """Return the harmonics of the motion that an estimate of the whole experiment takes."""
    noise, experiment = configuration.robot.noise, configuration.run.experiment
    if (given := configuration.run.estimate.harmonics) is not None:
        return given
    if configuration.run.estimate.systematic == "none" or noise is None:
        return trajectory.harmonics
    base, sampling = trajectory.frequency, experiment.sampling
    per_period = sampling * trajectory.period
    samples = experiment.periods * per_period

    def of_lines(covariance: Array | None, spectrum: NoiseSpectrum | None) -> Noise:
        if spectrum is None:
            return covariance
        return lambda count: spectrum.harmonics(base, count, sampling, samples).value

    lengths = of_lines(noise.length_covariance, noise.length_spectrum)
    forces = of_lines(noise.force_covariance, noise.force_spectrum)
    recorded = RecordedNoise(lengths, forces, samples, per_period)
    raised = raised_harmonics(robot, trajectory, recorded)
    return max(trajectory.harmonics, min(raised, sampled_harmonics(per_period)))


def tolerance_std(names: tuple[str, ...], errors: ErrorShares) -> dict[str, dict[str, float]]:
    """Return the tolerances' share and the total by parameter, SI; nothing without tolerances."""
    found = {"systematic": errors.std_systematic, "total": errors.std} if errors.sources else {}
    return {key: dict(zip(names, std.tolist(), strict=True)) for key, std in found.items()}


def derived_precisions(
    configuration: RunConfiguration, evaluator: Evaluator, errors: ErrorShares
) -> tuple[KnownQuantity, ...]:
    """Return the derived quantities that the experiment determines; none of a changed machine."""
    if configuration.run.design.is_change:
        return ()
    robot = evaluator.robot
    every = np.eye(len(robot.parameters))[:, evaluator.columns]
    regrouping = _structure(configuration, evaluator).regrouping(robot.parameter_names)
    found = known_quantities(derived_quantities(robot), errors.of(every), robot.scales, regrouping)
    return tuple(found)


def precision_in_words(configuration: RunConfiguration, trajectory: FourierTrajectory) -> str:
    """Return the predicted precision of a motion: named quantities, the worst, measuring time.

    Named are the goals and quantities of interest of the run, by default the mass.
    """
    evaluator, run = noise_evaluator(configuration), configuration.run
    try:
        information, samples = experiment_information(evaluator, trajectory, configuration)
        errors = predicted_errors(configuration, evaluator, trajectory, information, samples)
    except fisher.SingularInformationError:
        return "not every parameter is identifiable"
    robot, wanted = evaluator.robot, run.wanted or ("mass",)
    scales = dict(zip(robot.parameter_names, robot.scales.tolist(), strict=True))
    std = dict(zip(evaluator.names, errors.std.tolist(), strict=True))
    shares = {name: value / scales[name] for name, value in std.items()}
    shown = []
    for one in derived_precisions(configuration, evaluator, errors):
        if not any(belongs_to(one.quantity, name) for name in wanted):
            continue
        if np.isfinite(one.rel_std_percent):
            size = _percent(one.rel_std_percent / 100)
        elif one.unit == "m":
            size = f"{1000 * one.std:.2g} mm"
        else:
            size = f"{one.std:.2g} {one.unit}"
        shown.append(f"{one.quantity} ± {size}")
    shown += [f"{name} ± {_percent(shares[name])}" for name in shares if name in wanted]
    worst = max(shares, key=shares.__getitem__)
    shown.append(f"the worst, {worst}, ± {_percent(shares[worst])}")
    measured = run.experiment.periods * trajectory.period
    return f"{', '.join(dict.fromkeys(shown))} in {measured:.3g} s of measuring"


def _structure(configuration: RunConfiguration, evaluator: Evaluator) -> BaseParameters:
    """Return the base parameters of the structure; other parameters count as known."""
    if configuration.run.design.parameters == "base":
        return structural_base(evaluator.robot)
    return BaseParameters.each(evaluator.names)


def identified_combinations(
    configuration: RunConfiguration, evaluator: Evaluator, information: Array, errors: ErrorShares
) -> tuple[KnownCombination, ...]:
    """Return the combinations that the whole experiment, with these errors, identifies."""
    robot, total = evaluator.robot, errors.covariance
    root = root_of_inverse(total) if errors.sources else root_of(information)
    base = identified_base(root, evaluator.names, robot.scales[evaluator.columns])
    structure, names = _structure(configuration, evaluator), robot.parameter_names
    judged = [names.index(name) for name in evaluator.names]
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(judged, judged)] = total
    return known_combinations(base, structure, names, robot.parameters, covariance, robot.scales)


def parameter_precisions(
    robot: Robot, predicted: result.PredictedStd, errors: ErrorShares
) -> Iterator[result.ParameterPrecision]:
    """Yield nominal value and predicted standard deviations of every judged parameter."""
    nominal = robot.description.parameters
    stds = zip(predicted.per_period.std.items(), errors.largest_source, strict=True)
    for (name, one_period), source in stds:
        experiment = predicted.experiment.std[name]
        size = abs(nominal[name]) or np.nan
        yield result.ParameterPrecision(
            name,
            parameter_unit(name),
            nominal[name],
            one_period,
            experiment,
            100 * one_period / size,
            100 * experiment / size,
            predicted.systematic.get(name, np.nan),
            predicted.total.get(name, np.nan),
            source if predicted.total else "",
        )


def scaled_eigenvalues(information: Array, scales: Array) -> Iterator[result.Eigenvalue]:
    """Yield the eigenvalues of F, (k, k), scaled to unit diagonal and by the parameters' scales."""
    by_nominal = np.linalg.eigvalsh(information * np.multiply.outer(scales, scales))
    values = fisher.ScaledInformation.of(information).eigenvalues()
    for number, pair in enumerate(zip(values, by_nominal, strict=True), start=1):
        yield result.Eigenvalue(number, *map(float, pair))


def imprecise(robot: Robot, predicted: result.PredictedStd, errors: ErrorShares) -> tuple[str, ...]:
    """Return a warning that names the parameters the experiment does not identify, or nothing."""
    scales = dict(zip(robot.parameter_names, robot.scales, strict=True))
    found = predicted.total or predicted.experiment.std
    share = {name: std / float(scales[name]) for name, std in found.items()}
    weak = {name: value for name, value in share.items() if not value <= IDENTIFIABLE}
    if not weak:
        return ()
    stated = ", ".join(f"{name} ({_percent(value)})" for name, value in weak.items())
    near = [name for name, value in weak.items() if value <= _NEARLY * IDENTIFIABLE]
    far = [name for name in weak if name not in near]
    limiting = {
        source
        for name, source in zip(share, errors.largest_source, strict=True)
        if name in near and source != NOISE
    }
    floor = f" (these do not reduce the share of {listed(sorted(limiting))})" if limiting else ""
    remedies = []
    if near:
        remedies.append(f"measure more periods{f' for {listed(near)}' if far else ''}{floor}")
    if far:
        remedies.append(
            f"no sensible number of periods is enough for {listed(far)}, hardly excited by this "
            "motion: widen speed, acceleration or workspace"
        )
    return (
        f"not identifiable with this experiment: {stated}. In brackets the predicted standard "
        f"deviation, which is to be below {100 * IDENTIFIABLE:g} % of the value: "
        f"{'; '.join(remedies)}, or state what is known (`estimate.fixed`, "
        "`estimate.prior`)",
    )


@dataclass(frozen=True, eq=False)
class ToleranceEffects:
    """Effects of the tolerances on the parameters of a motion, t of them on k parameters."""

    sources: tuple[str, ...]
    """(t,), key of each tolerance."""
    response: Array
    """(k, t), of one standard deviation of each on the Gauss–Markov estimate, SI."""
    joint: Array | None = None
    """(k + t, k + t), information on the parameters, SI, and on the inexact quantities in units of
    their tolerances; None for a change since an identification."""
    samples: float = 1.0
    """Number of samples in `joint`."""
    earlier: Array | None = None
    """(k + t, k + t), information of earlier recordings, which adds to `joint`; None: none."""

    def shares(self, random: Array, samples: float, *, estimated: bool) -> ErrorShares:
        """Return the errors of an experiment with so many samples.

        `random`, (k, k), is the covariance due to noise with exact tolerances, SI, with the earlier
        recordings. If `estimated`, the inexact quantities are estimated with the parameters, by
        their tolerances as priors.
        """
        if self.earlier is not None and self.joint is not None and self.sources:
            count = len(self.response)
            joint = self.joint * (samples / self.samples) + self.earlier
            response = _solve_scaled(joint[:count, :count], joint[:count, count:])
            whole = replace(self, response=response, joint=joint, samples=1.0, earlier=None)
            return whole.shares(random, 1.0, estimated=estimated)
        if not estimated or self.joint is None or not self.sources:
            return ErrorShares(random, self.response, self.sources)
        responses, eigenvalues, modes = self._decomposition
        data = eigenvalues * (samples / self.samples)
        prior = 1 / (data + 1)
        data = data * prior**2
        noise = (responses * data) @ responses.T
        return ErrorShares(random + noise, responses * prior @ modes.T, self.sources)

    @cached_property
    def _decomposition(self) -> tuple[Array, Array, Array]:
        """Modes of the inexact quantities with free parameters.

        Effects on the parameters, (k, t), information, (t,), and the modes, (t, t).
        """
        joint, count = np.asarray(self.joint), len(self.response)
        own, mixed, others = joint[:count, :count], joint[:count, count:], joint[count:, count:]
        errors = _solve_scaled(own, mixed)
        eigenvalues, modes = np.linalg.eigh(others - mixed.T @ errors)
        # What the data do not show at all is a rounding error.
        seen = eigenvalues > _UNSEEN * np.max(np.diag(others))
        return errors @ modes, np.where(seen, eigenvalues, 0.0), modes

    def scaled(self, sources: tuple[str, ...], factor: float) -> ToleranceEffects:
        """Return the effects with some tolerances multiplied by a factor."""
        return self.rescaled(np.where(np.isin(self.sources, sources), factor, 1.0))

    def rescaled(self, factors: Array) -> ToleranceEffects:
        """Return the effects with each tolerance multiplied by a factor, (t,)."""
        joint, earlier = self.joint, self.earlier
        if joint is not None:
            both = np.append(np.ones(len(self.response)), factors)
            joint = joint * np.multiply.outer(both, both)
            earlier = None if earlier is None else earlier * np.multiply.outer(both, both)
        return replace(self, response=self.response * factors, joint=joint, earlier=earlier)


def _solve_scaled(information: Array, columns: Array) -> Array:
    """Return F⁻¹ of columns, (k, t), with F, (k, k), scaled to unit diagonal."""
    scale = np.sqrt(np.diag(information))
    factor = sla.cho_factor(information / np.multiply.outer(scale, scale))
    return np.asarray(sla.cho_solve(factor, columns / scale[:, None]) / scale[:, None])


def combine_effects(
    parts: Sequence[ToleranceEffects], samples: Sequence[float]
) -> ToleranceEffects:
    """Return the effects on one estimate from several recordings, of so many samples each.

    The tolerances are those of one machine; the response has the weights of `joint`.
    """
    first, count = parts[0], len(parts[0].response)
    if first.joint is None:
        return first
    weighted = [
        np.asarray(part.joint) * (own / part.samples)
        for part, own in zip(parts, samples, strict=True)
    ]
    joint = np.sum(weighted, axis=0)
    response = _solve_scaled(joint[:count, :count], joint[:count, count:])
    return replace(first, response=response, joint=joint, samples=sum(samples))


def tolerance_effects(
    evaluator: Evaluator,
    trajectory: FourierTrajectory,
    samples: int,
    length_covariance: Array | None,
    harmonics: int | None = None,
    *,
    change: Marginal | None = None,
) -> ToleranceEffects:
    """Return the effects of the tolerances on the parameters of a motion and an evaluator.

    They are evaluated at the nominal parameters, with exact signs of friction, whose changes are
    neglected; the response has weights for white noise. `samples` are those of one period, and
    `harmonics` those of the estimated motion, by default those of the motion. Without a
    `length_covariance`, Δ (6, 6), m², all lengths have equal weights. For the `change` since an
    identification the evaluator's names are those of the changed parameters.
    """
    robot, names, memory = evaluator.robot, evaluator.names, evaluator.memory
    chosen = deviation.toleranced_deviations(robot)
    if not chosen and (change is None or not change.moved):
        return ToleranceEffects((), np.zeros((len(names), 0)))
    times = np.arange(samples) * trajectory.period / samples
    bases = _bases(trajectory, times, trajectory.harmonics)
    table = np.concatenate(
        [trajectory.lambda0[:, None], trajectory.sine, trajectory.cosine], axis=1
    )
    state = np.concatenate([basis @ table.T for basis in bases], axis=1)
    forces = deviation.deviating_forces(robot, state, times, None, robot.parameters, chosen)
    exact = deviation.exact_signs(robot, state)
    jumps = deviation.delay_of_jumps(
        robot, state, exact, robot.parameters, trajectory.period / samples
    )
    deviation.add_jumps(forces.columns, chosen, jumps)
    lengths = deviation.length_deviation_columns(robot, state, times, chosen)
    jacobian = robot.length_jacobian(state[:, :COORDINATES])
    equal = np.eye(ACTUATORS) if length_covariance is None else length_covariance
    white = fisher.whitening(equal)
    tolerances = np.array([each.tolerance for each in chosen])
    shifts = _rows(lengths, white)
    if harmonics is not None:
        bases = _bases(trajectory, times, harmonics)
    by_motion = _rows(np.einsum("sic,sh->sich", jacobian, bases[0]), white)
    norms = np.linalg.norm(by_motion, axis=0)
    by_motion /= norms
    normal = sla.cho_factor(by_motion.T @ by_motion)
    moved = sla.cho_solve(normal, by_motion.T @ shifts) / norms[:, None]
    slope = np.zeros((samples, ACTUATORS, len(moved)))
    for order in range(3):
        own = slice(COORDINATES * order, COORDINATES * (order + 1))
        along = np.einsum("sic,sh->sich", forces.state_slope[:, :, own], bases[order])
        slope += along.reshape(slope.shape)
    used = names if change is None else robot.parameter_names
    judged = [robot.parameter_names.index(name) for name in used]
    regressors = forces.regressors[:, :, judged]
    unexplained = (forces.columns - slope @ moved) * tolerances
    white = fisher.whitening(evaluator.covariance)
    known, unknown = _rows(regressors, white), _rows(unexplained, white)
    if change is not None:
        keys = [one.key for one in chosen]
        causes = dict(zip(keys, (known.T @ unknown).T, strict=True))
        information = known.T @ known
        for key, moved_before in change.moved.items():
            causes[key] = causes.get(key, 0.0) - information @ moved_before
        response = change.gain(information, samples) @ np.array(list(causes.values())).T
        groups = {one.name: one.group for one in deviation.deviations(robot)}
        return ToleranceEffects(tuple(groups.get(name, name) for name, _ in causes), response)
    sizes = np.linalg.norm(known, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    response = np.linalg.lstsq(known / sizes, unknown, rcond=None)[0] / sizes[:, None]
    extended = np.concatenate([regressors, unexplained], axis=2)
    if memory is None:
        joint = fisher.information_matrix(extended, evaluator.covariance)
    else:
        joint = memory.information(extended, trajectory.omega)
    return ToleranceEffects(tuple(each.group for each in chosen), response, joint, samples)


def _bases(trajectory: FourierTrajectory, times: Array, harmonics: int) -> tuple[Array, ...]:
    """Return derivatives 0 … 3 of 1, sin kωt, cos kωt with respect to time, (S, 2 H + 1) each."""
    orders = np.arange(1, harmonics + 1)
    phases = PhaseBasis.at(trajectory.omega * times, harmonics)
    third = -(np.concatenate([[0.0], orders, orders]) ** 2) * phases.first
    derivatives = (phases.value, phases.first, phases.second, third)
    return tuple(trajectory.omega**n * basis for n, basis in enumerate(derivatives))


def _rows(columns: Array, white: Array) -> Array:
    """Return columns (S, 6, …) scaled to unit covariance, one row per channel and sample."""
    count = int(np.prod(columns.shape[2:]))
    flat = columns.reshape(*columns.shape[:2], count)
    return np.matmul(white, flat).reshape(flat.shape[0] * flat.shape[1], count)


def whole(value: float) -> int | None:
    """Return a value as an integer where it is one but for rounding, else None."""
    return round(value) if abs(value - round(value)) < _WHOLE else None


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "without bound"
    return f"{float(f'{100 * share:.2g}'):g} %"  # 190 %, not 1.9e+02 %
