"""A hexapod that is independent of the package: plain NumPy from a robot file to a recording.

Positions, rates and accelerations of all bodies follow from those of the platform; Newton's and
Euler's equations of the platform and Lagrange's of each strut give the forces by virtual work. On
top of the model a machine can have one effect that the model lacks, see `EFFECTS`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import yaml
from scipy import signal

STRUTS = 6


def _rows(a, b):
    """Return the scalar products of vectors, (..., 3) each."""
    return np.einsum("...i,...i->...", a, b)


@dataclass(frozen=True)
class Motion:
    """Periodic motion of the platform: Fourier coefficients of its rate, (6, n), and its middle."""

    omega: float
    middle: np.ndarray
    cosines: np.ndarray
    sines: np.ndarray

    @classmethod
    def read(cls, keys):
        """Take it from the keys of `design.json`."""
        values = (np.array(keys[name], dtype=float) for name in ("lambda0", "mu", "nu"))
        return cls(float(keys["omega"]), *values)

    @property
    def period(self):
        """Duration of a period [s]."""
        return 2 * np.pi / self.omega

    def at(self, times):
        """Return pose, rate and acceleration, (T, 6) each: x, y, z and the angles."""
        line = self.omega * np.arange(1, self.cosines.shape[1] + 1)
        c, s = np.cos(np.outer(times, line)), np.sin(np.outer(times, line))
        pose = self.middle + (s / line) @ self.cosines.T - (c / line) @ self.sines.T
        rate = c @ self.cosines.T + s @ self.sines.T
        return pose, rate, (c * line) @ self.sines.T - (s * line) @ self.cosines.T

    def with_tracking_error(self, std, lines, rng):
        """Return the motion with errors of the position [m] in the harmonics of a range."""
        count = lines[1]
        parts = np.zeros((2, STRUTS, count))
        parts[0, :, : self.cosines.shape[1]] = self.cosines
        parts[1, :, : self.sines.shape[1]] = self.sines
        chosen = np.arange(lines[0], lines[1] + 1)
        drawn = rng.standard_normal((2, 3, len(chosen))) * std / np.sqrt(len(chosen))
        parts[:, :3, chosen - 1] += drawn * chosen * self.omega
        return replace(self, cosines=parts[0], sines=parts[1])


@dataclass(frozen=True)
class Movement:
    """State of all bodies at T instants; vectors in the base frame."""

    times: np.ndarray
    rotation: np.ndarray
    """(T, 3, 3)."""
    omega: np.ndarray
    omega_rate: np.ndarray
    """(T, 3), angular velocity of the platform and its rate."""
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    """(T, 3), of the tool centre point."""
    arms: np.ndarray
    """(T, 6, 3), from the tool centre point to the joints."""
    directions: np.ndarray
    """(T, 6, 3), unit vectors along the struts."""
    lengths: np.ndarray
    length_rates: np.ndarray
    length_accelerations: np.ndarray
    alpha_rate: np.ndarray
    alpha_acceleration: np.ndarray
    beta: np.ndarray
    beta_rate: np.ndarray
    beta_acceleration: np.ndarray
    """(T, 6)."""
    across: tuple[np.ndarray, np.ndarray]
    """(T, 6, 3) each, directions in which the tips move with α and with β."""
    second_axis: np.ndarray
    """(T, 6, 3), axis of β."""


@dataclass(frozen=True)
class Extra:
    """Loads in addition to those of the model."""

    along: np.ndarray | float = 0.0
    """(T, 6), forces of the actuators [N]."""
    about: tuple[np.ndarray | float, np.ndarray | float] = (0.0, 0.0)
    """(T, 6) each, moments of the actuators about the axes of α and β [N m]."""
    wrench: tuple[np.ndarray | float, np.ndarray | float] = (0.0, 0.0)
    """(T, 3) each, force [N] and moment about the tool centre point [N m] of the actuators."""
    field: np.ndarray | float = 0.0
    """(T, 3), addition to gravity in the base frame [m/s²]."""

    def __add__(self, other):
        """Return both loads together."""
        pairs = (("about", self.about, other.about), ("wrench", self.wrench, other.wrench))
        both = {name: tuple(map(np.add, one, two)) for name, one, two in pairs}
        return Extra(along=self.along + other.along, field=self.field + other.field, **both)


@dataclass(frozen=True)
class Machine:
    """Geometry, parameters and terms of a machine."""

    base_joints: np.ndarray
    platform_joints: np.ndarray
    alpha_axes: np.ndarray
    second: np.ndarray
    third: np.ndarray
    """(6, 3), axes of the cardan frames in the base."""
    gravity: np.ndarray
    parameters: dict[str, float]

    @classmethod
    def read(cls, path):
        """Take a machine from a robot file with numbers in SI units."""
        about = yaml.safe_load(path.read_text())
        base, platform = (np.array(about[f"{end}_joints"]) for end in ("base", "platform"))
        home = np.array(about["home"], dtype=float)
        axes = about.get("alpha_axes")
        axes = base * [1, 1, 0] if axes is None else np.array(axes)
        axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        spans = home[:3] + platform @ _rotation(home[None, 3:])[0].T - base
        third = spans - _rows(spans, axes)[:, None] * axes
        third /= np.linalg.norm(third, axis=1, keepdims=True)
        gravity = np.array(about.get("gravity", [0, 0, -9.81]), dtype=float)
        parameters = {name: float(value) for name, value in about["parameters"].items()}
        return cls(base, platform, axes, np.cross(third, axes), third, gravity, parameters)

    def each(self, letter):
        """Return a parameter of each actuator, (6,); zeros where the machine has none."""
        return np.array([self.parameters.get(f"{letter}{j + 1}", 0.0) for j in range(STRUTS)])

    def lengths_at(self, pose):
        """Return the lengths of the struts [m], (T, 6), at poses, (T, 6)."""
        arms = np.einsum("tik,jk->tji", _rotation(pose[:, 3:]), self.platform_joints)
        return np.linalg.norm(pose[:, None, :3] + arms - self.base_joints, axis=2)

    def move(self, motion, times):
        """Return the state of all bodies along a motion."""
        pose, rate, acceleration = motion.at(times)
        rotation = _rotation(pose[:, 3:])
        omega, omega_rate = _angular(pose[:, 3:], rate[:, 3:], acceleration[:, 3:])
        arms = np.einsum("tik,jk->tji", rotation, self.platform_joints)
        spin, change = omega[:, None, :], omega_rate[:, None, :]
        spans = pose[:, None, :3] + arms - self.base_joints
        speeds = rate[:, None, :3] + np.cross(spin, arms)
        second = acceleration[:, None, :3] + np.cross(change, arms)
        second = second + np.cross(spin, np.cross(spin, arms))
        lengths = np.linalg.norm(spans, axis=2)
        u = spans / lengths[..., None]
        length_rates = _rows(u, speeds)
        u_rate = (speeds - length_rates[..., None] * u) / lengths[..., None]
        length_accelerations = _rows(u, second) + lengths * _rows(u_rate, u_rate)
        u_second = second - 2 * length_rates[..., None] * u_rate
        u_second = (u_second - length_accelerations[..., None] * u) / lengths[..., None]
        x, y, z = self.alpha_axes, self.second, self.third
        sine = _rows(u, x)
        cosine = np.sqrt(1 - sine**2)
        sa, ca = -_rows(u, y) / cosine, _rows(u, z) / cosine
        axis = ca[..., None] * y + sa[..., None] * z
        with_alpha = -axis
        up = -sa[..., None] * y + ca[..., None] * z
        with_beta = cosine[..., None] * x - sine[..., None] * up
        alpha_rate, beta_rate = _rows(with_alpha, u_rate) / cosine, _rows(with_beta, u_rate)
        return Movement(
            times, rotation, omega, omega_rate, pose[:, :3], rate[:, :3], acceleration[:, :3], arms,
            u, lengths, length_rates, length_accelerations, alpha_rate,
            (_rows(with_alpha, u_second) + 2 * sine * alpha_rate * beta_rate) / cosine,
            np.arcsin(sine), beta_rate,
            _rows(with_beta, u_second) - sine * cosine * alpha_rate**2,
            (with_alpha, with_beta), axis,
        )  # fmt: skip

    def forces(self, now, extra=None):
        """Return the forces of the actuators, (T, 6) [N]."""
        extra = Extra() if extra is None else extra
        p = self.parameters.get
        field = self.gravity + extra.field
        of_strut = field if np.ndim(field) == 1 else field[:, None, :]
        sine, cosine = np.sin(now.beta), np.cos(now.beta)
        length, dl = now.lengths, now.length_rates
        da, db = now.alpha_rate, now.beta_rate
        lumped, turning = p("p2") + 2 * p("p5") * length, 2 * cosine * sine * da * db
        weight = p("p4") + p("p5")
        with_alpha, with_beta = now.across
        about_alpha = (
            (p("p1") + lumped * cosine**2) * now.alpha_acceleration
            - lumped * turning
            + 2 * p("p5") * dl * cosine**2 * da
            - weight * cosine * _rows(with_alpha, of_strut)
            + p("r_alpha") * np.sign(da)
            + extra.about[0]
        )
        about_beta = (
            (p("p3") + 2 * p("p5") * length) * now.beta_acceleration
            + 2 * p("p5") * dl * db
            + lumped * cosine * sine * da**2
            - weight * _rows(with_beta, of_strut)
            + p("r_beta") * np.sign(db)
            + extra.about[1]
        )
        # Moments about the cardan axes act on the platform as forces at the joints.
        tips = (about_alpha / (length * cosine))[..., None] * with_alpha
        tips = tips + (about_beta / length)[..., None] * with_beta
        force, moment = self.platform_wrench(now, field)
        force = force + np.sum(tips, axis=1) + extra.wrench[0]
        moment = moment + np.sum(np.cross(now.arms, tips), axis=1) + extra.wrench[1]
        twists = np.concatenate([now.directions, np.cross(now.arms, now.directions)], axis=2)
        load = np.concatenate([force, moment], axis=1)
        found = np.linalg.solve(np.swapaxes(twists, 1, 2), load[..., None])[..., 0]
        found += -p("p5") * (cosine**2 * da**2 + db**2)
        return found + self.each("r") * np.sign(dl) + self.each("v") * dl + extra.along

    def platform_wrench(self, now, field):
        """Return force and moment about the tool centre point that move the platform, (T, 3)."""
        p = self.parameters.get
        own = np.array([p("sx", 0.0), p("sy", 0.0), p("p9")])
        inertia = np.array(
            [
                [p("p6"), p("Ixy", 0.0), p("Ixz", 0.0)],
                [p("Ixy", 0.0), p("p7"), p("Iyz", 0.0)],
                [p("Ixz", 0.0), p("Iyz", 0.0), p("p8")],
            ]
        )
        first = now.rotation @ own
        tensor = now.rotation @ inertia @ np.swapaxes(now.rotation, 1, 2)
        falling = now.acceleration - field
        centre = np.cross(now.omega_rate, first)
        centre = centre + np.cross(now.omega, np.cross(now.omega, first))
        momentum = np.einsum("tij,tj->ti", tensor, now.omega)
        moment = np.einsum("tij,tj->ti", tensor, now.omega_rate) + np.cross(now.omega, momentum)
        return p("p10") * falling + centre, moment + np.cross(first, falling)


def _rotation(angles):
    """Return Rx Ry Rz, (T, 3, 3), of angles (T, 3)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles.T), np.sin(angles.T)
    rows = (
        (cy * cz, -cy * sz, sy),
        (cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
        (sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def _angular(angles, rates, accelerations):
    """Return the angular velocity and its rate, (T, 3) each."""
    one, zero = np.ones(len(angles)), np.zeros(len(angles))
    (cx, cy, _), (sx, sy, _) = np.cos(angles.T), np.sin(angles.T)
    axes = np.array([[one, zero, zero], [zero, cx, sx], [sy, -sx * cy, cx * cy]])
    omega = np.einsum("kit,tk->ti", axes, rates)
    # Each axis turns with the rotations before it.
    before = np.zeros_like(rates)
    change = np.einsum("kit,tk->ti", axes, accelerations)
    for k in range(3):
        part = axes[k].T * rates[:, k, None]
        change = change + np.cross(before, part)
        before = before + part
    return omega, change


# --- effects that the model lacks -----------------------------------------------------------------


_FINER = 10


def _dahl(path, width):
    """Return the state of Dahl's friction, -1 … 1, along a periodic path; `width` is its scale."""
    fine = signal.resample(path, _FINER * len(path))
    steps = np.diff(fine, axis=0, prepend=fine[-1:])
    signs, kept = np.sign(steps), np.exp(-np.abs(steps) / width)
    state, found = np.zeros(path.shape[1]), np.empty_like(fine)
    for _ in range(2):
        for k, sign in enumerate(signs):
            state = sign - (sign - state) * kept[k]
            found[k] = state
    return found[::_FINER]


def _response(values, times, transfer):
    """Filter a period of uniform samples, (N, 3), by a function of the angular frequency."""
    step = times[1] - times[0]
    line = 2 * np.pi * np.fft.rfftfreq(len(times), step)
    spectrum = np.fft.rfft(values, axis=0) * transfer(line)[:, None]
    return np.fft.irfft(spectrum, len(times), axis=0)


def _drive_inertia(machine, now, size):
    return Extra(along=size * now.length_accelerations)


def _quadratic(machine, now, size):
    speed = now.length_rates
    return Extra(along=size * machine.each("v") * np.abs(speed) * speed)


def _power_law(machine, now, size):
    speed = now.length_rates
    powered = np.sign(speed) * np.abs(speed) ** size
    return Extra(along=machine.each("v") * (powered - speed))


def _viscous_joints(machine, now, size):
    return Extra(about=(size * now.alpha_rate, size * now.beta_rate))


_DECAY = 0.3
"""Speed of the slow decay of Stribeck friction [m/s]."""


def _stribeck(machine, now, size):
    speed = now.length_rates
    shape = np.exp(-np.abs(speed) / _DECAY) * np.sign(speed)
    return Extra(along=size * machine.each("r") * shape)


_PRESLIDING = 0.02
"""Scale of the hysteresis of a cable that drags on the platform [m]."""


def _cable_drag(machine, now, size):
    return Extra(wrench=(size * _dahl(now.position, _PRESLIDING), 0.0))


_BASE = 200.0
"""Mass of a base on springs [kg]."""
_DAMPING = 0.05


def _base_on_springs(machine, now, size):
    own = 2 * np.pi * size
    reaction = -machine.platform_wrench(now, np.zeros(3))[0]

    def transfer(line):
        response = -(line**2) / (own**2 - line**2 + 2j * _DAMPING * own * line)
        return response / (_BASE + machine.parameters["p10"])

    return Extra(field=-_response(reaction, now.times, transfer))


def _position_friction(machine, now, size):
    middle, half = _stroke(now.lengths)
    along = machine.each("r") * size * (now.lengths - middle) / half
    return Extra(along=along * np.sign(now.length_rates))


def _stroke(lengths):
    low, high = np.min(lengths, axis=0), np.max(lengths, axis=0)
    return (low + high) / 2, (high - low) / 2


def _direction_friction(machine, now, size):
    return Extra(along=size * (machine.each("r") + machine.each("v") * np.abs(now.length_rates)))


def _asymmetric(machine, now, size):
    return Extra(along=size * np.abs(now.length_rates))


def _presliding(machine, now, size):
    sign = np.sign(now.length_rates)
    return Extra(along=machine.each("r") * (_dahl(now.lengths, size) - sign))


_SLOSHING = 2.0
"""Frequency of a liquid that moves in a tank on the platform [Hz]."""
_TANK = np.array([0.0, 0.0, 0.05])
"""Its place in the platform frame [m]."""


def _liquid(machine, now, size):
    turn, own = now.rotation, 2 * np.pi * _SLOSHING
    arm = turn @ _TANK
    felt = now.acceleration - machine.gravity + np.cross(now.omega_rate, arm)
    felt = felt + np.cross(now.omega, np.cross(now.omega, arm))
    across = np.einsum("tki,tk->ti", turn, felt) * [1, 1, 0]

    def displace(line):
        return -1 / (own**2 - line**2 + 2j * _DAMPING * own * line)

    moved = _response(across, now.times, displace)
    faster = _response(across, now.times, lambda line: -(line**2) * displace(line))
    moved, faster = (np.einsum("tik,tk->ti", turn, part) for part in (moved, faster))
    force = size * faster
    return Extra(wrench=(force, np.cross(arm, force) + np.cross(moved, size * (felt + faster))))


def _at_balls(machine, now, moments_of):
    """Return the load of moments in the joints of the platform, by their angular velocity."""
    first = machine.alpha_axes
    relative = now.omega[:, None, :] - now.alpha_rate[..., None] * first
    moment = moments_of(relative - now.beta_rate[..., None] * now.second_axis)
    about = (-_rows(moment, first), -_rows(moment, now.second_axis))
    return Extra(about=about, wrench=(0.0, np.sum(moment, axis=1)))


def _ball_friction(machine, now, size):
    def dry(omega):
        return size * omega / np.linalg.norm(omega, axis=2, keepdims=True)

    return _at_balls(machine, now, dry)


def _viscous_balls(machine, now, size):
    return _at_balls(machine, now, lambda omega: size * omega)


_PITCH = 0.03
"""Pitch of a ripple [m]."""


def _ripple(machine, now, size):
    wave = np.sin(2 * np.pi * now.lengths / _PITCH)
    return Extra(along=size * np.abs(now.length_rates) * wave)


def _load_friction(machine, now, size):
    frictionless = {
        name: 0.0 if name[0] in "rv" else value for name, value in machine.parameters.items()
    }
    load = replace(machine, parameters=frictionless).forces(now)
    return Extra(along=size * np.abs(load) * np.sign(now.length_rates))


_LOADS: dict[str, Callable] = {
    "drive_inertia": _drive_inertia,
    "quadratic_friction": _quadratic,
    "power_law": _power_law,
    "viscous_joints": _viscous_joints,
    "slow_stribeck": _stribeck,
    "cable_drag": _cable_drag,
    "base_on_springs": _base_on_springs,
    "position_friction": _position_friction,
    "direction_friction": _direction_friction,
    "presliding": _presliding,
    "liquid": _liquid,
    "ball_friction": _ball_friction,
    "speed_ripple": _ripple,
    "load_friction": _load_friction,
    "asymmetric_friction": _asymmetric,
    "viscous_balls": _viscous_balls,
}
_PLATFORM = {
    "products_of_inertia": {"Ixy": 1.0, "Ixz": -0.7, "Iyz": 0.5},
    "off_centre": {"sx": 0.8, "sy": 0.6},
}
"""Parameters of the platform per size [kg m²], and per size [m] and mass."""
_MEASURED = ("saturation", "low_pass", "length_delays", "clock_jitter", "force_offset")
EFFECTS = (*_LOADS, *_PLATFORM, *_MEASURED)

_FULL = 200.0
"""Force at which saturation is stated [N]."""
_NODES, _WEIGHTS = np.polynomial.laguerre.laggauss(8)


@dataclass(frozen=True)
class Sensors:
    """Errors of the measurement by a machine."""

    zeros: np.ndarray = field(default_factory=lambda: np.zeros(STRUTS))
    """(6,), added to the lengths [m]."""
    gains: np.ndarray = field(default_factory=lambda: np.zeros(STRUTS))
    """(6,), relative errors of the forces."""
    delay: float = 0.0
    """Time by which the forces lag behind the lengths [s]."""


def changed_parameters(machine, effects):
    """Return the parameters of a machine with effects, of which some are another platform."""
    parameters = dict(machine.parameters)
    for effect in set(effects) & set(_PLATFORM):
        unit = parameters["p10"] if effect == "off_centre" else 1.0
        for name, share in _PLATFORM[effect].items():
            parameters[name] = parameters.get(name, 0.0) + share * unit * effects[effect]
    return parameters


def simulate(machine, motion, times, effects=None, *, sensors=None, rng=None):
    """Return lengths and forces without noise, (T, 6) each, of a machine with effects.

    Effects with a memory need the uniform instants of exactly one period, the jitter of the clock
    a generator of random numbers. Sizes of effects are numbers, those of effects of the actuators
    may be (6,).
    """
    effects, sensors = effects or {}, Sensors() if sensors is None else sensors
    if unknown := set(effects) - set(EFFECTS):
        raise ValueError(f"unknown effects {unknown}")
    machine = replace(machine, parameters=changed_parameters(machine, effects))
    loads = [(load, effects[effect]) for effect, load in _LOADS.items() if effect in effects]
    if "clock_jitter" in effects:
        times = times + effects["clock_jitter"] * rng.standard_normal(len(times))

    def forces_at(instants):
        now = machine.move(motion, instants - sensors.delay)
        return machine.forces(now, sum((load(machine, now, size) for load, size in loads), Extra()))

    lengths, forces = machine.move(motion, times).lengths, forces_at(times)
    forces = forces * (1 + effects.get("saturation", 0.0) * (forces / _FULL) ** 2)
    if "low_pass" in effects:
        late = sum(
            weight * forces_at(times - effects["low_pass"] * node)
            for node, weight in zip(_NODES, _WEIGHTS, strict=True)
        )
        forces = np.where(np.arange(STRUTS) % 2 == 1, late, forces)
    if "length_delays" in effects:
        delays = effects["length_delays"] * np.arange(STRUTS)
        columns = [machine.move(motion, times - d).lengths[:, j] for j, d in enumerate(delays)]
        lengths = np.stack(columns, axis=1)
    forces = (forces + effects.get("force_offset", 0.0)) * (1 + sensors.gains)
    return lengths + sensors.zeros, forces


_LINES, _ITERATIONS, _STEP = 100, 6, 1e-6


class NoPoseError(ValueError):
    """No pose of a machine has the lengths of another one."""


def follow_lengths(machine, drawn, motion, zeros):
    """Return the motion of a machine whose struts have the lengths of a drawn one, less zeros.

    Newton's method with slopes by differences, and the Fourier series of the poses. Where some
    instant has no pose, `NoPoseError` is raised.
    """
    times = motion.period * np.arange(4 * _LINES) / (4 * _LINES)
    pose = motion.at(times)[0]
    wanted = drawn.lengths_at(pose) - zeros
    for _ in range(_ITERATIONS):
        pairs = (
            machine.lengths_at(pose + step) for e in np.eye(6) for step in (_STEP * e, -_STEP * e)
        )
        ahead, behind = np.array(list(pairs)).reshape(6, 2, *pose.shape).swapaxes(0, 1)
        slope = np.moveaxis(ahead - behind, 0, 2) / (2 * _STEP)
        rest = wanted - machine.lengths_at(pose)
        pose = pose + np.linalg.solve(slope, rest[..., None])[..., 0]
    if not np.abs(rest).max() < 1e-12:
        raise NoPoseError("no pose of the machine has these lengths")
    series = 2 * np.fft.rfft(pose, axis=0)[: _LINES + 1].T / len(times)
    line = motion.omega * np.arange(1, _LINES + 1)
    middle, waves = series[:, 0].real / 2, series[:, 1:] * line
    return replace(motion, middle=middle, cosines=-waves.imag, sines=-waves.real)


def deviate(machine, tolerances, rng):
    """Draw a machine, its sensors and its effects from the `tolerances` of a robot file, SI."""

    def draw(key, shape=STRUTS, of=tolerances):
        return of.get(key, 0.0) * rng.standard_normal(shape)

    tilt = np.array([*draw("gravity", 2), 0.0])
    gravity = machine.gravity + np.cross(tilt, machine.gravity)
    moved = replace(
        machine,
        base_joints=machine.base_joints + draw("base_joints", (STRUTS, 3)),
        platform_joints=machine.platform_joints + draw("platform_joints", (STRUTS, 3)),
        gravity=gravity * np.linalg.norm(machine.gravity) / np.linalg.norm(gravity),
    )
    constant, terms = tolerances.get("force_constant", {}), tolerances.get("terms", {})
    gains = draw("common", (), constant) + draw("each", STRUTS, constant)
    sensors = Sensors(draw("strut_length"), gains, float(draw("delay", ())))
    effects = {
        name: draw(name, () if name == "drive_inertia" else STRUTS, terms)
        for name in (
            "drive_inertia", "force_offset", "load_friction", "asymmetric_friction",
            "quadratic_friction",
        )
    }  # fmt: skip
    effects["quadratic_friction"] /= machine.each("v")
    for name in ("viscous_joints", "viscous_balls"):
        effects[name] = draw("passive_viscous_friction", (), terms)
    return moved, sensors, effects


def read_noise(path):
    """Return the covariances of forces [N²] and lengths [m²], (6, 6) each, of a robot file."""
    noise = yaml.safe_load(path.read_text())["noise"]

    def covariance(kind, unit):
        std = unit * np.array([float(text.split()[0]) for text in noise[f"{kind}_std"]])
        return np.outer(std, std) * np.array(noise.get(f"{kind}_correlation", np.eye(STRUTS)))

    return covariance("force", 1.0), covariance("length", 1e-3)


def draw_noise(count, covariance, rng, memory=0.0):
    """Draw noise, (T, 6), of a covariance and a correlation from sample to sample."""
    white = rng.standard_normal((count, STRUTS)) @ np.linalg.cholesky(covariance).T
    gain = np.full(count, np.sqrt(1 - memory**2))
    gain[0] = 1.0  # from its stationary distribution on
    return signal.lfilter([1.0], [1.0, -memory], white * gain[:, None], axis=0)
