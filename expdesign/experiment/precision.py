"""The predicted precision of a design: random errors by noise, systematic ones by tolerances.

The systematic errors follow from the sensitivity of the estimate. The Gauss–Markov estimate takes
the motion from the lengths, as a series of the design's harmonics. For a machine with deviations θ
the lengths yield another motion, and the forces other parameters: with L = ∂l/∂ξ

    ∂ξ̂/∂θ = (Σ Lᵀ Δ⁻¹ L)⁻¹ Σ Lᵀ Δ⁻¹ Z_l,
    D = F⁻¹ Σ Aᵀ Σ⁻¹ (Z_f − ∂(A p)/∂ξ · ∂ξ̂/∂θ).

D does not depend on the number of periods.

For a change π since an identification with the same tolerances and the error D₀ θ of its parameters
the common part of both errors cancels: with S and R of `expdesign.information.fisher`

    D = S⁻¹ Rᵀ (Σ Aᵀ Σ⁻¹ (Z_f − …) − F D₀).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.configuration.schema import MOST_SAMPLES
from expdesign.experiment import result
from expdesign.information import fisher
from expdesign.information.identifiable import (
    IDENTIFIABLE,
    BaseParameters,
    KnownCombination,
    identified_base,
    known_combinations,
    root_of,
)
from expdesign.information.marginal import Marginal
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.terms import parameter_unit
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.information import Evaluator
from expdesign.robot import Robot, deviation
from expdesign.trajectory import FourierTrajectory, PhaseBasis

_WHOLE = 1e-6
_LARGE = 100.0


def experiment_information(
    evaluator: Evaluator, trajectory: FourierTrajectory, configuration: RunConfiguration
) -> tuple[Array, int]:
    """Return F of the whole experiment, (k, k), and its number of samples."""
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
    # The whole prior counts, whatever the measuring time.
    counted = total if evaluator.marginal is None else evaluator.marginal.samples
    return evaluator.judged(information, counted), total


def precision(
    evaluator: Evaluator, information: Array, samples: int, periods: float
) -> result.PredictedPrecision:
    """Return the standard deviations of F, (k, k), over so many samples and periods."""
    std = np.sqrt(np.diag(fisher.parameter_covariance(information, evaluator.names)))
    named = dict(zip(evaluator.names, std.tolist(), strict=True))
    return result.PredictedPrecision(samples, periods, named)


def identified_combinations(
    configuration: RunConfiguration, evaluator: Evaluator, information: Array
) -> tuple[KnownCombination, ...]:
    """Return the combinations that the whole experiment, with this information, identifies."""
    robot = evaluator.robot
    base = identified_base(root_of(information), evaluator.names, robot.scales[evaluator.columns])
    # Parameters neither judged nor regrouped count as known.
    together = configuration.run.design.parameters == "base"
    structure = structural_base(robot) if together else BaseParameters.each(evaluator.names)
    at = [robot.parameter_names.index(name) for name in structure.names]
    judged = [structure.names.index(name) for name in evaluator.names]
    covariance = np.zeros((len(at), len(at)))
    covariance[np.ix_(judged, judged)] = fisher.parameter_covariance(information, evaluator.names)
    scales = dict(zip(robot.parameter_names, robot.scales.tolist(), strict=True))
    return known_combinations(base, structure, robot.parameters[at], covariance, scales)


def parameter_precisions(
    robot: Robot, predicted: result.PredictedStd
) -> Iterator[result.ParameterPrecision]:
    """Yield nominal value and predicted standard deviations of every judged parameter."""
    nominal = robot.description.parameters
    for name, one_period in predicted.per_period.std.items():
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
        )


def scaled_eigenvalues(information: Array, scales: Array) -> Iterator[result.Eigenvalue]:
    """Yield the eigenvalues of F, (k, k), scaled to unit diagonal and by the parameters' scales."""
    by_nominal = np.linalg.eigvalsh(information * np.multiply.outer(scales, scales))
    values = fisher.ScaledInformation.of(information).eigenvalues()
    for number, pair in enumerate(zip(values, by_nominal, strict=True), start=1):
        yield result.Eigenvalue(number, *map(float, pair))


def imprecise(robot: Robot, precision: result.PredictedPrecision) -> tuple[str, ...]:
    """Return a warning that names the parameters the experiment does not identify, or nothing."""
    scales = dict(zip(robot.parameter_names, robot.scales, strict=True))
    share = {name: std / float(scales[name]) for name, std in precision.std.items()}
    weak = [f"{n} ({_percent(value)})" for n, value in share.items() if not value <= IDENTIFIABLE]
    if not weak:
        return ()
    return (
        f"not identifiable with this experiment: {', '.join(weak)}. In brackets the predicted "
        f"standard deviation, which is to be below {100 * IDENTIFIABLE:g} % of the value: measure "
        "more periods, or state what is known (`estimate.fixed`, `estimate.prior`)",
    )


def systematic_std(
    robot: Robot,
    trajectory: FourierTrajectory,
    samples: int,
    names: tuple[str, ...],
    force_covariance: Array,
    length_covariance: Array | None,
    change: Marginal | None = None,
) -> dict[str, float]:
    """Return the standard deviation due to the tolerances, by parameter, SI; empty without any.

    It is evaluated at the nominal parameters, with exact signs of friction, whose changes are
    neglected, and with weights for white noise.

    Parameters
    ----------
    samples : int
        Samples of one period.
    names : tuple of str
        Estimated parameters; the others are known.
    force_covariance : (6, 6)
        Σ, N².
    length_covariance : (6, 6) or None
        Δ, m²; None: equal weights of all lengths.
    change : Marginal, optional
        Change since an identification: the names are then those of the changed parameters.
    """
    chosen = deviation.toleranced_deviations(robot)
    if not chosen and (change is None or not change.moved):
        return {}
    times = np.arange(samples) * trajectory.period / samples
    bases = _bases(trajectory, times)
    table = np.concatenate(
        [trajectory.lambda0[:, None], trajectory.sine, trajectory.cosine], axis=1
    )
    state = np.concatenate([basis @ table.T for basis in bases], axis=1)
    forces = deviation.deviating_forces(robot, state, times, None, robot.parameters, chosen)
    exact = deviation.exact_signs(robot, state)
    jumps = deviation.delay_of_jumps(
        robot, state, exact, robot.parameters, trajectory.period / samples
    )
    late = [one.group == "delay" for one in chosen]
    forces.columns[:, :, late] += jumps[:, :, None]
    lengths = deviation.length_deviation_columns(robot, state, times, chosen)
    jacobian = robot.length_jacobian(state[:, :COORDINATES])
    equal = np.eye(ACTUATORS) if length_covariance is None else length_covariance
    by_motion = _rows(np.einsum("sic,sh->sich", jacobian, bases[0]), fisher.whitening(equal))
    moved = np.linalg.lstsq(by_motion, _rows(lengths, fisher.whitening(equal)), rcond=None)[0]
    slope = sum(
        np.einsum(
            "sic,sh->sich",
            forces.state_slope[:, :, COORDINATES * order : COORDINATES * (order + 1)],
            bases[order],
        )
        for order in range(3)
    )
    white = fisher.whitening(force_covariance)
    used = names if change is None else robot.parameter_names
    judged = [robot.parameter_names.index(name) for name in used]
    regressors = _rows(forces.regressors[:, :, judged], white)
    unexplained = _rows(forces.columns, white) - _rows(np.asarray(slope), white) @ moved
    if change is not None:
        seen = (regressors.T @ unexplained).T
        causes = {one.key: row * one.tolerance for one, row in zip(chosen, seen, strict=True)}
        information = regressors.T @ regressors
        for key, moved_before in change.moved.items():
            causes[key] = causes.get(key, 0.0) - information @ moved_before
        response = change.gain(information, samples) @ np.array(list(causes.values())).T
        return dict(zip(names, np.linalg.norm(response, axis=1).tolist(), strict=True))
    sizes = np.linalg.norm(regressors, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    response = np.linalg.lstsq(regressors / sizes, unexplained, rcond=None)[0] / sizes[:, None]
    share = np.linalg.norm(response * np.array([each.tolerance for each in chosen]), axis=1)
    return dict(zip(names, share.tolist(), strict=True))


def _bases(trajectory: FourierTrajectory, times: Array) -> tuple[Array, ...]:
    """Return derivatives 0 … 3 of 1, sin kωt, cos kωt with respect to time, (S, 2 H + 1) each."""
    orders = np.arange(1, trajectory.sine.shape[1] + 1)
    phases = PhaseBasis.at(trajectory.omega * times, len(orders))
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
    return f"{100 * share:.2g} %" if share > _LARGE else f"{100 * share:.0f} %"
