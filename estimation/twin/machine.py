"""Measured machine: lengths at its motors and their forces, without noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from constraints.arrays import Array, Mask
from expdesign.configuration import RunConfiguration
from expdesign.configuration.estimate import Delay
from expdesign.configuration.experiment import ForceConstantError, LowPass
from expdesign.export.execution import blocks
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms import friction, platform_forces, rigid_platform, struts
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.recheck.limit_check import Motion
from expdesign.robot import Robot, deviation
from expdesign.robot.robot import solve_rows
from expdesign.trajectory import PoseSamples

CARRIED = frozenset(
    term.name
    for term in (
        struts.TERM,
        rigid_platform.GENERAL,
        friction.PASSIVE,
        friction.VISCOUS_JOINTS,
        *platform_forces.TERMS,
    )
)
"""Terms of the bodies and of the passive joints: their forces pass through the elastic struts.
All others, such as friction of the actuators, act at the motor."""
_STEP = 2e-5
"""Step of the numerical derivative of the struts' load, s."""
_NEWTON_STEPS = 3
"""From a distance of a millimetre, the first step leaves micrometres, the third only rounding."""
_FURTHEST = 0.02
"""Largest deformation of a strut, m; larger values are invalid."""
_REACHED = 1e-9
"""Largest remaining error of a length, m."""
_FINE = 5e-5
"""Step of a simulated low pass, s."""
_SETTLED = 12.0
"""Time constants after which the beginning of a low pass has no effect."""


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot with rigid or elastic struts.

    An elastic strut has a massless spring between the motor and all moving parts. Its load F
    shortens it: l_motor − l = compliance · F, where l is the distance of the joints, and F,
    positive in extension, comes from bodies and passive joints. The sensor at the motor measures
    l_motor; the friction of the actuator depends on the motor's speed.

    The platform executes the given motion, as with the springs' model in the controller, and the
    motors move accordingly. F therefore belongs to a known motion, and neither the equation above
    nor the inertia of vibrating parts is approximated.
    """

    robot: Robot
    compliance: Array
    """(6,), m/N; 0 for a rigid strut."""

    def measure(
        self,
        motion: Motion,
        times: Array,
        delay: float = 0.0,
        channel_delay: Delay | None = None,
        low_pass: LowPass | None = None,
    ) -> tuple[Array, Array, Array]:
        """Return the quantities at the sensors, without measurement errors.

        Parameters
        ----------
        motion : Motion
            Motion of the platform.
        times : (D,) array
            Times of the length measurements, s.
        delay : float
            Lag of the forces, s.
        channel_delay : Delay, optional
            Lags of single channels, s.
        low_pass : LowPass, optional
            Time constants of the sensors, s.

        Returns
        -------
        lengths : (D, 6) array
            Lengths at the motors, m.
        forces : (D, 6) array
            Forces of the actuators at the times less their delays, N.
        positions : (D, 6) array
            Lengths at the motors at the time of these forces, m.
        """
        channels = channel_delay or Delay()
        late, length_late = np.add(delay, channels.forces), np.array(channels.lengths)
        positions, forces = _by_channel(late, lambda own: self._motor_states(motion, times - own))
        lengths = positions
        if not np.array_equal(late, length_late):
            (lengths,) = _by_channel(length_late, lambda own: (self._lengths(motion, times - own),))
        slow = low_pass or LowPass()
        if any(slow.forces):
            driven = _low_pass(
                lambda fine: self._motor_states(motion, fine)[1], times, late, slow.forces
            )
            forces = np.where(np.array(slow.forces) > 0, driven, forces)
        if any(slow.lengths):
            read = _low_pass(
                lambda fine: self._lengths(motion, fine), times, length_late, slow.lengths
            )
            lengths = np.where(np.array(slow.lengths) > 0, read, lengths)
        return lengths, forces, positions

    def _lengths(self, motion: Motion, times: Array) -> Array:
        """Return the lengths at the motors alone, (D, 6), m."""
        found = []
        for at in blocks(times):
            with np.errstate(all="ignore"):
                states = motion.sample(at)
                lengths = self.robot.inverse_kinematics(states.pose)
                if self.elastic:
                    lengths = lengths + self.compliance * self._load_force(states)
            found.append(lengths)
        return np.concatenate(found)

    def _motor_states(self, motion: Motion, times: Array) -> tuple[Array, Array]:
        """Return lengths at the motors, m, and their forces, N, (D, 6) each."""
        lengths, forces = [], []
        for at in blocks(times):
            # The caller refuses infinities due to absurd motions.
            with np.errstate(all="ignore"):
                states = motion.sample(at)
                if self.elastic:
                    length, force = self._by_springs(motion, at, states)
                else:
                    length = self.robot.inverse_kinematics(states.pose)
                    force = self.robot.actuator_forces(*states)
            lengths.append(length)
            forces.append(force)
        return np.concatenate(lengths), np.concatenate(forces)

    @property
    def elastic(self) -> bool:
        """True if any strut is elastic."""
        return bool(np.any(self.compliance))

    def _load_force(self, states: PoseSamples) -> Array:
        """Return the load of the struts, (D, 6), N."""
        bodies, passive, _ = self._shares()
        return self.robot.regressor(*states) @ (self.robot.parameters * (bodies | passive))

    def _by_springs(self, motion: Motion, times: Array, states: PoseSamples) -> tuple[Array, Array]:
        robot = self.robot
        bodies, _, at_motors = self._shares()
        carried = self._load_force(states)
        # Jumps of dry friction in the passive joints have no finite speed and are left out.
        ahead, behind = (
            robot.regressor(*motion.sample(times + step)) @ (robot.parameters * bodies)
            for step in (_STEP, -_STEP)
        )
        joints = robot.strut_motion(*states)
        lengths = joints.length + self.compliance * carried
        speeds = joints.length_rate + self.compliance * (ahead - behind) / (2 * _STEP)
        if not np.max(np.abs(lengths - joints.length)) <= _FURTHEST:
            return np.full_like(lengths, np.nan), carried
        # State with the lengths and speeds of the motors, for the terms at the motors.
        pose = states.pose
        for _ in range(_NEWTON_STEPS):
            reached, jacobian = robot.lengths_and_jacobian(pose)
            pose = pose + solve_rows(jacobian, lengths - reached)
        reached, jacobian = robot.lengths_and_jacobian(pose)
        if not np.max(np.abs(lengths - reached)) <= _REACHED:
            return np.full_like(lengths, np.nan), carried
        rate = solve_rows(jacobian, speeds)
        at_motor = robot.regressor(pose, rate, states.acceleration)
        return lengths, carried + at_motor @ (robot.parameters * at_motors)

    def _shares(self) -> tuple[Mask, Mask, Mask]:
        """Return masks of parameters: smooth load terms, other terms, terms outside the motor."""
        kinds = [
            (
                term.name in CARRIED and not term.is_friction,
                term.name in CARRIED and term.is_friction,
            )
            for term in self.robot.terms
            for _ in term.parameters
        ]
        smooth, jumping = np.array(kinds, dtype=bool).reshape(-1, 2).T
        return smooth, jumping, ~(smooth | jumping)


def with_motors(machine: Robot, robot: Robot) -> tuple[Robot, Array]:
    """Return a machine with the damping of its motors, and the ratio of read to true forces, (6,).

    The read forces are its voltages at rest by the constants of the robot; a machine without
    constants has these.
    """
    known, about = robot.description.drive, machine.description
    drive = about.drive if about.drive.motor is not None else about.drive.with_motors(known)
    about = replace(about, drive=drive, forces_of_voltages=True, tolerances=None)
    about = Robot(about).extended.description
    damping = zip((one.name for one in BACK_EMF.parameters), drive.back_emf, strict=True)
    driven = Robot(replace(about, parameters={**about.parameters, **dict(damping)}))
    return driven, np.divide(known.forces_per_volt, drive.forces_per_volt)


@dataclass(frozen=True, eq=False)
class DrawnMachine:
    """A random machine within the tolerances of a run's robot."""

    configuration: RunConfiguration
    """Run with this true machine, for `Twin.of`; its robot is unchanged."""
    deviations: tuple[deviation.Deviation, ...]
    """Drawn entries: all with a tolerance."""
    values: Array
    """(t,), deviation of each entry, SI."""


def _by_channel(delays: Array, read: Callable[[float], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return series, (D, 6) each, that are read anew for the channels of each delay, (6,)."""
    found = read(delays[0])
    for delay in np.unique(delays[delays != delays[0]]):
        others = read(delay)
        found = tuple(np.where(delays == delay, *each) for each in zip(others, found, strict=True))
    return found


def _low_pass(
    read: Callable[[Array], Array], times: Array, delays: Array, constants: Sequence[float]
) -> Array:
    """Return a series, (D, 6), behind first-order low passes, simulated in fine steps."""
    first = times[0] - np.max(delays) - _SETTLED * np.max(constants)
    fine = np.arange(first, times[-1] - np.min(delays) + 2 * _FINE, _FINE)
    columns = []
    for series, delay, constant in zip(read(fine).T, delays, constants, strict=True):
        decay = np.exp(-_FINE / constant) if constant else 0.0
        slope = (1 - decay) * constant / _FINE  # exact where the input is linear over a step
        rest = series - series[0]
        passed = signal.lfilter([1 - slope, slope - decay], [1.0, -decay], rest) + series[0]
        columns.append(np.interp(times - delay, fine, passed))
    return np.column_stack(columns)


def draw_machine(configuration: RunConfiguration, rng: np.random.Generator) -> DrawnMachine:
    """Draw deviations within the robot's tolerances from independent normal distributions.

    They are added to those of the run: to joints, gravity and constants of its true machine
    (`experiment.truth`, or the robot), and to `strut_length`, `force_constant`, `delay`,
    `channel_delay`, `low_pass` and `clock` of its `experiment`; a time constant is the absolute
    value of its draw. The true machine gets the terms that the robot lacks. Its other parameters
    and its noise remain.
    """
    voltages = configuration.records_voltages
    robot = Robot(replace(configuration.robot, forces_of_voltages=voltages))
    count = len(deviation.toleranced_deviations(robot))
    return machine_within_tolerances(configuration, rng.standard_normal(count))


def machine_within_tolerances(configuration: RunConfiguration, draws: Array) -> DrawnMachine:
    """Return the machine with deviations in units of their tolerances, (t,): see `draw_machine`."""
    base, voltages = configuration.truth or configuration.robot, configuration.records_voltages
    tolerances = configuration.robot.tolerances
    robot = Robot(replace(base, tolerances=tolerances, forces_of_voltages=voltages))
    entries = deviation.toleranced_deviations(robot)
    values = draws * np.array([each.tolerance for each in entries])
    values = np.where([each.lower == 0 for each in entries], np.abs(values), values)
    drawn = dict(zip((each.name for each in entries), values.tolist(), strict=True))
    off: dict[str, list[float]] = {}
    for entry in deviation.deviations(robot):
        off.setdefault(entry.group, []).append(drawn.get(entry.name, 0.0))
    section = configuration.run.experiment

    def of_channels(stated: Delay | LowPass, groups: dict[str, str]) -> Delay | LowPass:
        forces = np.add(stated.forces, off[groups["Q"]]).tolist()
        lengths = np.add(stated.lengths, off[groups["q"]]).tolist()
        return stated.model_copy(update={"forces": tuple(forces), "lengths": tuple(lengths)})

    error = section.force_constant or ForceConstantError()
    (common,) = off["force_constant.common"]
    drive, supply = base.drive, np.zeros(ACTUATORS)
    if voltages:
        constant, resistance, supply = (
            np.add(off[f"motor.{name}.common"], off[f"motor.{name}.each"])
            for name in deviation.MOTOR_EFFECTS
        )
        known = drive if drive.motor is not None else configuration.robot.drive
        # The deviations are errors of what is known.
        drive = drive.with_motors(known, np.exp(-constant).tolist(), np.exp(-resistance).tolist())
    each = zip(error.each, off["force_constant.each"], np.expm1(supply).tolist(), strict=True)
    constants = {
        "common": _product(error.common, common),
        "each": tuple(_product(_product(stated, drawn), read) for stated, drawn, read in each),
    }
    moved = deviation.apply_deviations(robot, entries, values)
    about = replace(moved.description, forces_of_voltages=False)
    extended = replace(moved, description=about).extended.description
    truth = replace(extended, tolerances=base.tolerances, drive=drive)
    described = deviation.as_in_a_file(truth).model_copy(update={"drive": drive})
    measured = configuration.with_section(
        "experiment",
        truth=described,
        strut_length=tuple(np.add(section.strut_length, off["strut_length"]).tolist()),
        force_constant=error.model_copy(update=constants),
        delay=section.delay + sum(off["delay"]),
        channel_delay=of_channels(section.channel_delay, deviation.CHANNEL_DELAYS),
        low_pass=of_channels(section.low_pass, deviation.LOW_PASSES),
        clock=section.clock + sum(off["clock"]),
    )
    truth = replace(truth, description=described)
    return DrawnMachine(replace(measured, truth=truth), entries, values)


def _product(stated: float, drawn: float) -> float:
    return (1 + stated) * (1 + drawn) - 1
