"""Tracking errors of one machine under one controller, feed-forward by feed-forward."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from constraints.arrays import Array, Mask
from estimation.estimators import PerturbedMachine
from estimation.feedforward.closed_loop import (
    Controller,
    FollowedMotion,
    ForwardDynamics,
    Model,
    TrackingTask,
    follow_motion,
)
from estimation.feedforward.result import (
    MEANINGS,
    CaseName,
    ControllerSettings,
    FeedforwardCase,
    FeedforwardResult,
    IntegrationSettings,
    StrutRow,
    Tracking,
)
from estimation.identification.calibration import estimated_machine
from estimation.identification.estimate import IdentifiedModel
from estimation.twin.disturbances import Repeated, force_gains, noise_sources, repetition_stream
from expdesign.configuration import ComputationError, RunConfiguration
from expdesign.configuration.experiment import Cogging
from expdesign.configuration.schema import MOST_SAMPLES, require_at_most
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.strut import ANGLES
from expdesign.mechanism.term import parameters_of
from expdesign.motion.benchmark import broken_limits, motion_name, motion_of_run
from expdesign.progress import progress_prefix
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import Deviation
from expdesign.trajectory import FourierTrajectory, PoseSamples

WIDTH = 1e-3
"""Width of the smoothed friction, relative to the fastest strut's largest speed."""
_FEWEST = 5
"""Smallest number of integration steps between two samples of the controller."""
_TRIED = 64
"""Number of poses along the motion for the choice of the step."""


def compare_feedforward(
    configuration: RunConfiguration,
    saved: IdentifiedModel,
    design: FourierTrajectory | None,
    width: float = WIDTH,
) -> FeedforwardResult:
    """Simulate the machine on a motion with each feed-forward of the section `feedforward:`.

    The designed motion is given if it is followed; `width` is that of the smoothed friction,
    relative to the fastest strut's largest speed.
    """
    began, section = time.perf_counter(), configuration.run.feedforward
    nominal = robot_from(configuration.robot)
    motion = design or motion_of_run(configuration, section, nominal.home, "feedforward")
    step = configuration.run.controller_period
    _refuse_long(configuration, motion)
    name = motion_name(section)
    with threadpool_limits(limits=1, user_api="blas"):
        times = step * np.arange(round(section.periods * motion.period / step), dtype=np.float64)
        last = round((section.periods - 1) * motion.period / step)
        machine = estimated_machine(nominal, saved.estimate.systematic)
        truth = true_machine(configuration, saved, machine, times)
        models: dict[CaseName, Model] = {
            "nominal": Model(nominal, nominal.parameters),
            "identified": _with_lacking_terms(machine.robot, saved.estimate.values),
            "true": truth.model,
        }
        # The commands of a controller are measured forces; the models' forces are true ones.
        gains: dict[CaseName, Array] = {"identified": machine.gains, "true": truth.gains}
        loop = _Loop(configuration, nominal, truth, motion, times, width)
        forces = _feedforwards(models, motion, times + step / 2, gains)
        found, integration = loop.compare(forces)
    tracking = {case: _tracking(loop, found, place, last) for place, case in enumerate(forces)}
    added = found.commands - np.array(list(forces.values()))
    feedback = dict(zip(forces, added[:, last:], strict=True))
    controller = loop.controller
    broken = broken_limits(nominal, motion, name)
    doubt = f"the estimate of the fed-forward model is doubtful: {saved.doubt}"
    return FeedforwardResult(
        name=configuration.run.name,
        robot=nominal.name,
        estimate=str(saved.path),
        estimator=saved.estimate.estimator,
        machine=truth.kind,
        motion=name,
        period=motion.period,
        periods=float(section.periods),
        controller=ControllerSettings(
            sampling=1 / step,
            bandwidth=section.bandwidth,
            damping_ratio=section.damping,
            integral_corner=section.integral,
            filter=section.filter,
            mass=controller.mass,
            stiffness=controller.stiffness,
            damping=controller.damping,
            integral=controller.integral,
        ),
        integration=integration,
        cases=tuple(
            _case(case, tracking, feedback[case], limited[last:])
            for case, limited in zip(forces, found.limited, strict=True)
        ),
        seconds=time.perf_counter() - began,
        warnings=(*configuration.warnings, *broken, *([doubt] if saved.doubt else [])),
        within_limits=not broken,
        rows=tuple(
            StrutRow(
                case=case,
                strut=j + 1,
                rms=_rms(tracking[case].struts[:, j]),
                max=_largest(tracking[case].struts[:, j]),
                rms_feedback=_rms(feedback[case][:, j]),
            )
            for case in forces
            for j in range(ACTUATORS)
        ),
        tracking=tuple(tracking.values()),
    )


def _refuse_long(configuration: RunConfiguration, motion: FourierTrajectory) -> None:
    section, step = configuration.run.feedforward, configuration.run.controller_period
    made = f"{section.periods} periods of {motion.period:.4g} s at {1 / step:g} Hz"
    count = len(MEANINGS) * section.periods * motion.period / step
    content = f"{made}, {len(MEANINGS)} times"
    require_at_most(count, MOST_SAMPLES, content, configuration.file, "feedforward.periods")


def _feedforwards(
    models: dict[CaseName, Model],
    motion: FourierTrajectory,
    times: Array,
    gains: dict[CaseName, Array],
) -> dict[CaseName, Array]:
    """Return the forces of each case, (T, 6), N, in the controller's units.

    They are the true forces times the gains of the model (measured over true; 1 without any). The
    nominal model is left out if it is the true one.
    """
    states = motion.sample(times)
    nominal = models["nominal"]
    at_rest = PoseSamples(states.pose, *np.zeros((2, *states.pose.shape)))
    found: dict[CaseName, Array] = {
        "none": np.zeros_like(states.pose),
        "gravity": nominal.forces(at_rest),
        **{case: model.forces(states) * gains.get(case, 1.0) for case, model in models.items()},
    }
    if np.array_equal(found["nominal"], found["true"]):
        del found["nominal"]
    return found


class _Loop:
    """Machine, controller and the commanded motion."""

    def __init__(
        self,
        configuration: RunConfiguration,
        nominal: Robot,
        truth: TrueMachine,
        motion: FourierTrajectory,
        times: Array,
        width: float,
    ) -> None:
        section, experiment = configuration.run.feedforward, configuration.run.experiment
        step, count = configuration.run.controller_period, len(times)
        self.states = motion.sample(times)
        struts = nominal.strut_motion(*self.states)
        width *= float(np.max(np.abs(struts.length_rate)))
        self.machine = ForwardDynamics(truth.model, width, truth.cogging)
        limit = nominal.limit("actuator_force")
        endless = np.full(ACTUATORS, np.inf)
        known = ForwardDynamics(Model(nominal, nominal.parameters), width)
        self.controller = Controller.of(
            section,
            np.diag(known.mass_matrix(nominal.home)).copy(),
            step,
            (-endless, endless) if limit is None else limit.stated_bounds,
        )
        noise = noise_sources(configuration, count, 1 / step)[1]
        stream = repetition_stream(experiment.seed, FIRST_DRAW, Repeated.LENGTH_NOISE)
        resolution = experiment.quantisation
        self.task = TrackingTask(
            lengths=struts.length,
            noise=noise.draw(stream),
            resolution=0.0 if resolution is None else resolution.length,
            gains=truth.gains,
        )
        # The true machine with the commanded lengths and speeds of the struts.
        robot = truth.model.robot
        pose = robot.forward_kinematics(struts.length[0], self.states.pose[0])
        rate = np.linalg.solve(robot.length_jacobian(pose), struts.length_rate[0])
        self.start = np.concatenate([pose, rate])

    def compare(self, forces: dict[CaseName, Array]) -> tuple[FollowedMotion, IntegrationSettings]:
        """Simulate all cases, and once more with half the step and half the width."""
        step = self.controller.step
        poses = self.states.pose[:: max(1, len(self.states.pose) // _TRIED)]
        substeps = max(_FEWEST, int(np.ceil(step / self.machine.longest_step(poses))))
        finer = replace(self.machine, width=self.machine.width / 2)
        found, again = (
            self._follow(machine, forces, count, words)
            for machine, count, words in (
                (self.machine, substeps, "all feed-forwards"),
                (finer, 2 * substeps, "the same in smaller steps"),
            )
        )
        sizes = [
            np.array([_rms(own) for own in self.task.lengths - one.lengths])
            for one in (found, again)
        ]
        change = float(np.max(np.abs(sizes[1] - sizes[0])) / sizes[0][0])
        return found, IntegrationSettings(step / substeps, self.machine.width, change)

    def _follow(
        self, machine: ForwardDynamics, forces: dict[CaseName, Array], substeps: int, words: str
    ) -> FollowedMotion:
        # As after many periods: the integral compensates the mean error of the feed-forward.
        lacking = [np.mean(forces["true"] - given, axis=0) for given in forces.values()]
        integral = np.array(lacking) * (self.controller.integral > 0)
        with progress_prefix(words):
            return follow_motion(
                machine, self.controller, self.task, forces, self.start, integral, substeps
            )


def _tracking(loop: _Loop, found: FollowedMotion, place: int, last: int) -> Tracking:
    """Return the errors of one case over the last period."""
    wanted, reached = loop.states.pose[last:], found.states[place, last:, :COORDINATES]
    turned = [Rotation.from_euler(ANGLES, pose[:, 3:]) for pose in (wanted, reached)]
    return Tracking(
        time=loop.controller.step * np.arange(len(wanted), dtype=np.float64),
        struts=loop.task.lengths[last:] - found.lengths[place, last:],
        position=np.linalg.norm((wanted - reached)[:, :3], axis=1),
        rotation=(turned[0].inv() * turned[1]).magnitude(),
        forces=found.commands[place, last:],
    )


def _case(
    case: CaseName, tracking: dict[CaseName, Tracking], feedback: Array, limited: Mask
) -> FeedforwardCase:
    """Return the tracking errors of one case; feedback and limits of the last period are (T, 6)."""
    own = tracking[case]
    return FeedforwardCase(
        case=case,
        rms_struts=_rms(own.struts),
        max_struts=_largest(own.struts),
        rms_position=_rms(own.position),
        max_position=_largest(own.position),
        rms_rotation=_rms(own.rotation),
        max_rotation=_largest(own.rotation),
        rms_from_true=_rms(own.struts - tracking["true"].struts),
        rms_feedback=_rms(feedback),
        limited=float(np.mean(limited)),
        reduction=_rms(tracking["none"].struts) / _rms(own.struts),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))


_MOST_DRAWS = 10_000
FIRST_DRAW = 200_001
"""Number of the repetition of the loop's noise; no experiment and no validation uses it."""


@dataclass(frozen=True, eq=False)
class TrueMachine:
    """The machine in the loop."""

    kind: Literal["twin", "drawn"]
    model: Model
    cogging: Cogging | None
    gains: Array
    """(T, 6), measured over true force."""


def true_machine(
    configuration: RunConfiguration, saved: IdentifiedModel, machine: PerturbedMachine, times: Array
) -> TrueMachine:
    """Return the digital twin or, for recordings of a real machine, a random one.

    The true parameters of a real machine are unknown. They are drawn from the estimate's normal
    distribution until all are within their bounds: the simulation shows the effect of the
    estimate's uncertainty, but not that of the model's errors. Parameters and deviations θ
    (constants of terms, geometry, gains) are drawn jointly: their errors compensate each other in
    the forces.

    Raises
    ------
    ComputationError
        No machine with parameters within their bounds is found.
    """
    section = configuration.run.experiment
    if configuration.run.data.recording is None:
        robot = robot_from(configuration.truth or configuration.robot)
        gains = np.ones((len(times), ACTUATORS))
        if section.force_constant is not None:
            gains = force_gains(section.force_constant, times, float(times[-1]))
        return TrueMachine("twin", Model(robot, robot.parameters), section.cogging, gains)
    estimate, bounds = saved.estimate, parameters_of(machine.robot.terms)
    values, covariance = estimate.values, estimate.joint
    chosen: tuple[Deviation, ...] = ()
    if estimate.systematic is not None:
        values, chosen = estimate.joint_values, estimate.systematic.deviations
    endless = np.full(len(chosen), np.inf)
    lower = np.array([one.lower for one in bounds] + [one.lower for one in chosen])
    upper = np.concatenate([[one.upper for one in bounds], endless])
    # A parameter whose estimate is beyond its bound may stay there.
    within = (values >= lower) & (values <= upper)
    rng = np.random.default_rng(np.random.SeedSequence(section.seed, spawn_key=(FIRST_DRAW,)))
    # In standard deviations: units differ by orders, and rounding must not. A covariance with zeros
    # for what is exact is semidefinite, and rounding makes it less.
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    unit = covariance / np.multiply.outer(scale, scale)
    drawn = values + scale * rng.multivariate_normal(
        np.zeros(len(values)), unit, _MOST_DRAWS, check_valid="ignore", method="eigh"
    )
    kept = np.all(~within | ((drawn >= lower) & (drawn <= upper)), axis=1)
    if not np.any(kept):
        raise ComputationError(
            f"none of {_MOST_DRAWS} machines drawn from the estimate's covariance has all its "
            "parameters within their bounds: the estimate is too uncertain to be simulated"
        )
    values, theta = np.split(drawn[int(np.argmax(kept))], [len(bounds)])
    if chosen:
        machine = PerturbedMachine.of(robot_from(configuration.robot), chosen, theta)
    gains = np.tile(machine.gains, (len(times), 1))
    return TrueMachine("drawn", _with_lacking_terms(machine.robot, values), None, gains)


def _with_lacking_terms(robot: Robot, values: Array) -> Model:
    """Return the model with these parameters, (m,), and the robot's `lacking_parameters`."""
    extended = robot.extended
    return Model(extended, np.concatenate([values, extended.parameters[len(values) :]]))
