"""From recordings to identified parameters with their uncertainty and a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from estimation.data.measurement import Measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import ResidualDiagnosis
from estimation.diagnostics.noise_result import covariance_fields
from estimation.estimators import (
    ParameterEstimate,
    SystematicUncertainty,
    covariance_ml_less_gm,
)
from estimation.estimators.result import TEN
from estimation.identification.estimation import Estimation, estimate_parameters
from estimation.identification.estimator_result import (
    BodyResult,
    ConsistentResult,
    ConstantResult,
    DeviationResult,
    PayloadResult,
    SystematicResult,
)
from estimation.identification.identified_model import identified_robot
from estimation.identification.recording import PreparedRecording
from estimation.identification.result import (
    EstimatedMotion,
    EstimatedRecording,
    EstimationResult,
    EstimatorResult,
    WeightingNoise,
)
from estimation.uncertainty.consistency import ConsistentEstimate
from expdesign.configuration import ConfigurationLike
from expdesign.information.identifiable import listed
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import apply_deviations, estimated_constants, toleranced_deviations
from expdesign.trajectory import FourierKeys, FourierTrajectory, fourier_keys

_RARE = 0.01
"""Smallest p value that is stated: the test ends before it can resolve smaller ones."""
_NEAR = 1e-3
"""Smallest distance, in σ, that is stated."""


def estimate(
    config: ConfigurationLike,
    data: Measurement | Sequence[Measurement],
    design: FourierTrajectory | Sequence[FourierTrajectory | None] | None = None,
) -> EstimationResult:
    """Estimate the parameters from one or several recordings and diagnose the best estimate.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Its sections `estimate` and `noise` and its robot are used.
    data : Measurement or sequence of Measurement
        Recordings of different trajectories are combined in one estimate.
    design : FourierTrajectory or sequence, optional
        The trajectory of each recording (one for all of them, or one each); without it the period
        comes from the recording.

    Raises
    ------
    InputError
        The configuration, or a recording's period, does not fit.
    MotionFitError
        No motion has the measured lengths.
    UnidentifiableError
        The data do not determine some parameters at all; it names them.
    """
    estimation = estimate_parameters(config, data, design)
    return estimation_result(estimation, diagnose_estimation(estimation))


def diagnose_estimation(estimation: Estimation) -> ResidualDiagnosis | None:
    """Return the diagnosis of the best estimate; None after pointwise differentiation."""
    if not estimation.intervals_cover:
        return None
    return diagnose(estimation.robot, estimation.experiments, estimation.priors, estimation.best)


def estimation_result(
    estimation: Estimation, diagnosis: ResidualDiagnosis | None = None
) -> EstimationResult:
    """Return the result of an estimation with the diagnosis of its best estimate."""
    priors = estimation.priors
    return EstimationResult(
        name=estimation.configuration.run.name,
        robot=estimation.robot.name,
        parameters=priors.names,
        fixed=tuple(np.array(priors.names)[~priors.free].tolist()),
        best=estimation.best.estimator,
        recordings=tuple(_recording(recording) for recording in estimation.recordings),
        estimators={
            name: _estimator(estimation, found) for name, found in estimation.estimates.items()
        },
        cramer_rao_covariance=estimation.bound,
        covariance_ml_less_gm=covariance_ml_less_gm(estimation.estimates),
        intervals_cover=estimation.intervals_cover,
        intervals_note=_intervals_note(estimation),
        diagnostics=diagnosis,
        selection=estimation.selection,
        seconds=estimation.seconds,
        warnings=estimation.warnings,
        rows=estimation.rows,
        motions={
            number: _motion(estimation, number)
            for number, recording in enumerate(estimation.recordings, start=1)
            if recording.experiment.fit is not None
        },
        tables=() if diagnosis is None else diagnosis.recordings,
        identified=identified_robot(estimation, diagnosis),
    )


def _recording(prepared: PreparedRecording) -> EstimatedRecording:
    recording, noise = prepared.experiment.record, prepared.experiment.noise
    fit = prepared.experiment.fit
    free = fit is not None and fit.motion.free_frequency
    return EstimatedRecording(
        source=prepared.source,
        rows=recording.rows,
        dropped_rows=recording.dropped,
        lost_samples=recording.lost,
        samples=recording.samples,
        averaged=recording.averaged,
        periods=float(recording.periods),
        omega=float(recording.omega if fit is None else fit.motion.omega),
        omega_std=float(np.sqrt(fit.covariance[-1, -1])) if fit and free else None,
        period_source=recording.source.value,
        jitter=float(prepared.jitter),
        harmonics=prepared.harmonics,
        harmonics_of_forces=prepared.harmonics_of_forces,
        harmonics_of_the_design=prepared.least_harmonics,
        noise=WeightingNoise(
            **covariance_fields(noise),
            force_source=noise.forces.source,
            length_source=noise.lengths.source,
            includes_model_error=noise.forces.includes_model_error,
            force_spectrum=noise.forces.spectrum_words,
            length_spectrum=noise.lengths.spectrum_words,
        ),
    )


def _estimator(estimation: Estimation, found: ParameterEstimate) -> EstimatorResult:
    priors, name = estimation.priors, found.estimator
    motions = [
        motion.delayed(recording.experiment.record.origin).trajectory
        for motion, recording in zip(found.motions, estimation.recordings, strict=False)
    ]
    return EstimatorResult(
        status=found.status,
        converged=found.converged,
        iterations=found.iterations,
        cost=found.cost,
        seconds=found.seconds,
        values=dict(zip(priors.names, found.values.tolist(), strict=True)),
        covariance=found.covariance,
        covariance_forces=found.covariance_forces,
        covariance_kinematics=found.covariance_kinematics,
        covariance_joint=found.covariance_joint,
        freedom=found.freedom,
        colour=found.colour,
        covariance_systematic=found.covariance_systematic,
        systematic=_systematic(found.systematic),
        constants=tuple(_constants(robot_from(estimation.configuration.robot), found.systematic)),
        payload=_payload(estimation, name),
        consistent=_consistent(estimation.consistent[name], estimation.robot),
        combinations=estimation.combinations[name],
        base_parameters=priors.identified_combinations(
            estimation.robot, found.values, found.covariance
        ),
        inseparable=priors.inseparable_combinations(
            estimation.robot, found.values, found.covariance
        ),
        motions=tuple(FourierKeys(**fourier_keys(motion)) for motion in motions),
    )


def _systematic(systematic: SystematicUncertainty | None) -> SystematicResult | None:
    if systematic is None:
        return None
    numbers = zip(
        systematic.deviations, systematic.values.tolist(), systematic.std.tolist(), strict=True
    )
    return SystematicResult(
        estimated=systematic.estimated,
        deviations=tuple(
            DeviationResult(
                name=one.name,
                group=one.group,
                unit=one.unit,
                tolerance=one.std,
                value=value,
                std=std,
            )
            for one, value, std in numbers
        ),
        response=systematic.response,
        left=systematic.left,
    )


def _constants(robot: Robot, systematic: SystematicUncertainty | None) -> Iterator[ConstantResult]:
    """Yield the estimated constants of terms, of the robot as its file states it."""
    flagged = {one.name: one for one in estimated_constants(robot)}
    if systematic is None or not flagged:
        return
    found = apply_deviations(robot, systematic.deviations, systematic.values).description.constants
    places = [one.name for one in systematic.deviations]
    names = (f"{term.name}_{one.name}" for term in robot.terms for one in term.constants)
    for name, stated, value in zip(names, robot.description.constants, found, strict=True):
        if name in flagged and name in places:
            own = flagged[name]
            yield ConstantResult(
                constant=own.group.partition(".")[2],
                unit=own.unit,
                value=value,
                std=float(systematic.std[places.index(name)]),
                stated=stated,
                tolerance=own.std if np.isfinite(own.std) else np.nan,
            )


def _payload(estimation: Estimation, estimator: str) -> PayloadResult | None:
    payload = estimation.payloads.get(estimator)
    if payload is None:
        return None
    return PayloadResult(
        values=dict(zip(TEN, payload.values.tolist(), strict=True)),
        covariance=payload.covariance,
        covariance_systematic=payload.covariance_systematic,
        freedom=payload.freedom,
    )


def _consistent(found: ConsistentEstimate | None, robot: Robot) -> ConsistentResult | None:
    if found is None:
        return None
    known = robot.realisable.bodies(robot.parameters) is not None
    return ConsistentResult(
        values=dict(zip(robot.parameter_names, found.values.tolist(), strict=True)),
        moved=found.moved,
        exchanged=found.exchanged,
        distance=found.distance,
        p=found.p,
        significant=found.significant,
        active=found.active,
        spread=found.spread,
        low=found.low,
        high=found.high,
        bodies={
            name: BodyResult(mass=body.mass, moment=body.moment, inertia=body.inertia)
            for name, body in vars(found.bodies).items()
        },
        text=consistency_text(found, known=known),
    )


def consistency_text(found: ConsistentEstimate, *, known: bool) -> str:
    """Return the physical consistency of an estimate in words.

    Parameters
    ----------
    found : ConsistentEstimate
    known : bool
        The parameters of the robot file are physically consistent.
    """
    if found.exchanged:
        kind, others = "combinations", f" (with other values of {listed(found.exchanged)})"
    else:
        kind, others = "parameters", ""
    if found.realisable:
        return f"physically consistent: these {kind} belong to a possible set of bodies{others}"
    distance = (
        f"not physically consistent: the nearest consistent {kind}{others} are "
        f"{max(found.distance, _NEAR):.2g} σ away, at the limit of {', '.join(found.active)}; "
    )
    share = f"{100 * found.p:.3g} % at most" if found.p > _RARE else f"less than {100 * _RARE:g} %"
    chance = f"noise alone makes such a distance in {share} of the cases"
    if not found.significant:
        return f"{distance}{chance}: no reason for doubt"
    doubt = "the model may lack an effect, or a tolerance or the noise is stated too small"
    if not known:
        doubt += (
            ". The parameters of the robot file are physically inconsistent as well: so is a "
            "correct estimate of a twin with these parameters"
        )
    return f"{distance}{chance}: {doubt}"


def _motion(estimation: Estimation, number: int) -> EstimatedMotion:
    """Evaluate the best estimate at the samples of a recording, counted from 1."""
    experiment, motion = estimation.experiments[number - 1], estimation.best.motions[number - 1]
    recording, robot = experiment.record, estimation.robot
    length_state = motion.at(recording.lengths.times).state()
    return EstimatedMotion(
        recording.forces.times + recording.origin,
        motion.at(recording.forces.times).state(),
        recording.lengths.values,
        robot.inverse_kinematics(length_state[:, :COORDINATES]),
        recording.forces.values,
        experiment.regressors(robot, motion) @ estimation.best.values,
    )


def _intervals_note(estimation: Estimation) -> str:
    if not estimation.intervals_cover:
        return (
            "pointwise differentiation: the lengths' noise is in the regressor, which biases "
            "the estimates and is not in the intervals; they do not cover"
        )
    systematic = estimation.best.systematic
    counted = all(e.noise.forces.lines is not None for e in estimation.experiments)
    noise = f"the noise of forces and lengths, {'as it is' if counted else 'taken for white'}"
    if systematic is None or not systematic.inexact:
        return (
            f"95 %, with {noise}; they hold for exact geometry and force "
            f"constants: {_NO_TOLERANCES[bool(toleranced_deviations(estimation.robot))]}"
        )
    verb = "and what is left of" if systematic.with_priors else "and"
    return f"95 %, with {noise}, {verb} the robot's tolerances"


_NO_TOLERANCES = {
    False: "the robot file gives no tolerances",
    True: "its tolerances are left out (estimate.systematic: none)",
}
