"""A second computation of all that is limited, in 60 digits, from positions and energies alone.

Nothing of the package is used but numbers. Rates are differences in time of what the formulas of
positions give; forces follow from the energies by Lagrange's equations, and from the virtual work
of friction. Differences are taken over 1e-15, so that they are right to some thirty digits.
"""

import itertools
from functools import cached_property

import mpmath
from mpmath import mpf

mpmath.mp.dps = 60
STEP = mpf(10) ** -15
STRUTS = range(6)


def vector(values):
    return [mpf(float(value)) for value in values]


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), mpf(0))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(a, b, factor=1):
    return [x + factor * y for x, y in zip(a, b, strict=True)]


def norm(a):
    return mpmath.sqrt(dot(a, a))


def angle_between(a, b):
    return mpmath.atan2(norm(cross(a, b)), dot(a, b))


def turned(matrix, a):
    return [dot(row, a) for row in matrix]


def rotation(pose):
    """R = Rx(φ) Ry(θ) Rz(ψ), column by column of what becomes of e_x, e_y, e_z."""

    def turn(axis, angle, a):
        c, s = mpmath.cos(angle), mpmath.sin(angle)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        found = list(a)
        found[i], found[j] = c * a[i] - s * a[j], s * a[i] + c * a[j]
        return found

    columns = [
        turn(0, pose[3], turn(1, pose[4], turn(2, pose[5], [mpf(k == i) for k in range(3)])))
        for i in range(3)
    ]
    return [[columns[j][i] for j in range(3)] for i in range(3)]


def difference(function, at, order=1):
    """Return a derivative of a function of one number that returns a list."""
    if order == 1:
        parts = (function(at + STEP), 1), (function(at - STEP), -1)
        scale = 2 * STEP
    elif order == 2:
        parts = (function(at + STEP), 1), (function(at), -2), (function(at - STEP), 1)
        scale = STEP**2
    else:
        parts = (
            (function(at + 2 * STEP), 1),
            (function(at + STEP), -2),
            (function(at - STEP), 2),
            (function(at - 2 * STEP), -1),
        )
        scale = 2 * STEP**3
    return [sum(w * v[k] for v, w in parts) / scale for k in range(len(parts[0][0]))]


def clearance(a, b, c, d):
    """Return the distance of the segments a-b and c-d: the least over the square of both."""

    def to_segment(point, start, end):
        along = plus(end, start, -1)
        share = dot(plus(point, start, -1), along) / dot(along, along)
        return norm(plus(point, plus(start, along, min(max(share, mpf(0)), mpf(1))), -1))

    found = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)]
    one, two, offset = plus(b, a, -1), plus(d, c, -1), plus(a, c, -1)
    system = dot(one, one) * dot(two, two) - dot(one, two) ** 2
    if system > 0:
        s = (dot(one, two) * dot(two, offset) - dot(two, two) * dot(one, offset)) / system
        t = (dot(one, one) * dot(two, offset) - dot(one, two) * dot(one, offset)) / system
        if 0 <= s <= 1 and 0 <= t <= 1:
            found.append(norm(plus(plus(offset, one, s), two, -t)))
    return min(found)


class Machine:
    """A robot's numbers, and a motion of it."""

    def __init__(self, robot, trajectory):
        about = robot.description
        self.base = [vector(row) for row in about.base_joints]
        self.joints = [vector(row) for row in about.platform_joints]
        self.frames = [[vector(frame[:, k]) for k in range(3)] for frame in robot.cardan_frames]
        self.axes = [vector(row) for row in about.platform_joint_axes]
        self.gravity = vector(about.gravity)
        thread = about.platform_cardan_axes
        self.thread = None if thread is None else [vector(row) for row in thread]
        self.lead = mpf(float(about.thread_lead))
        self.length = mpf(float(robot.characteristic_length))
        self.p = {
            name: mpf(float(value))
            for name, value in zip(robot.parameter_names, robot.parameters, strict=True)
        }
        self.constants = {
            name: mpf(float(value))
            for name, value in zip(
                (f"{term.name}.{one.name}" for term in robot.terms for one in term.constants),
                about.constants,
                strict=True,
            )
        }
        self.trajectory = trajectory

    def parameter(self, name):
        return self.p.get(name, mpf(0))

    def pose(self, time):
        motion = self.trajectory
        omega, found = mpf(motion.omega), vector(motion.lambda0)
        for k in range(1, motion.harmonics + 1):
            c, s = mpmath.cos(k * omega * time), mpmath.sin(k * omega * time)
            for i in range(6):
                mu, nu = mpf(float(motion.mu[i, k - 1])), mpf(float(motion.nu[i, k - 1]))
                found[i] += (mu * s - nu * c) / (k * omega)
        return found

    def at(self, pose):
        return Pose(self, pose)

    def momenta(self, pose, rate):
        """Return ∂T/∂λ̇: T is quadratic in the rates, so that differences over 1 are exact."""
        found = []
        for i in range(6):
            unit = [mpf(k == i) for k in range(6)]
            ahead, behind = (self.kinetic(pose, plus(rate, unit, sign)) for sign in (1, -1))
            found.append((ahead - behind) / 2)
        return found

    def kinetic(self, pose, rate):
        def coordinates(step):
            at = self.at(plus(pose, rate, step))
            flat = [value for row in at.rotation for value in row]
            return [*at.alpha, *at.beta, *flat, *itertools.chain(*at.directions), *at.payload]

        now, moving = self.at(pose), difference(coordinates, mpf(0))
        alpha, beta, turning = moving[:6], moving[6:12], moving[12:21]
        swinging = [moving[21 + 3 * j : 24 + 3 * j] for j in STRUTS]
        p = self.parameter
        energy = p("m_payload") * dot(moving[39:], moving[39:]) / 2
        for j in STRUTS:
            energy += (
                p("p1") * alpha[j] ** 2
                + p("p2") * (mpmath.cos(now.beta[j]) * alpha[j]) ** 2
                + p("p3") * beta[j] ** 2
            ) / 2 + p("p5") * now.distances[j] * dot(swinging[j], swinging[j])
        R = now.rotation
        dR = [turning[3 * k : 3 * k + 3] for k in range(3)]
        # Rᵀ Ṙ has the platform's own angular velocity beside its diagonal.
        own = [sum(R[k][i] * dR[k][j] for k in range(3)) for i, j in ((2, 1), (0, 2), (1, 0))]
        first = [p("sx"), p("sy"), p("p9")]
        inertia = [
            [p("p6"), p("Ixy"), p("Ixz")],
            [p("Ixy"), p("p7"), p("Iyz")],
            [p("Ixz"), p("Iyz"), p("p8")],
        ]
        energy += p("p10") * dot(rate[:3], rate[:3]) / 2
        energy += dot(rate[:3], turned(R, cross(own, first)))
        return energy + dot(own, turned(inertia, own)) / 2

    def potential(self, pose):
        at, p = self.at(pose), self.parameter
        first = turned(at.rotation, [p("sx"), p("sy"), p("p9")])
        energy = -p("p10") * dot(self.gravity, pose[:3]) - dot(self.gravity, first)
        for j in STRUTS:
            energy -= (p("p4") + p("p5")) * dot(self.gravity, at.directions[j])
        energy -= p("m_payload") * dot(self.gravity, at.payload)
        if (length := self.constants.get("gravity_compensation.length")) is not None:
            stretched = at.compensated - length
            energy -= p("b_force") * stretched + p("b_stiffness") * stretched**2 / 2
        stretched = plus(pose[:3], self.point("platform_spring", *"xyz"), -1)
        for axis, angle in enumerate(("phi", "theta", "psi")):
            energy -= p(f"f_{'xyz'[axis]}") * pose[axis]
            energy += p(f"k_{'xyz'[axis]}") * stretched[axis] ** 2 / 2
            shares = [(1 - at.rotation[k][k]) * (-1) ** (k == axis) for k in range(3)]
            energy += p(f"k_{angle}") * sum(shares) / 2
        return energy

    def point(self, term, *names):
        """Return a point whose coordinates are constants, the origin where a robot has none."""
        return [self.constants.get(f"{term}.{name}", mpf(0)) for name in names]

    def turns(self, pose):
        """Return the slope of the platform's turn about the axes of the base, 3 × 6."""
        R, columns = rotation(pose), []
        for i in range(6):
            unit = [mpf(k == i) for k in range(6)]
            flat = difference(
                lambda s, u=unit: [v for row in rotation(plus(pose, u, s)) for v in row], mpf(0)
            )
            dR = [flat[3 * k : 3 * k + 3] for k in range(3)]
            columns.append([dot(dR[row], R[column]) for row, column in ((2, 1), (0, 2), (1, 0))])
        return mpmath.matrix(columns).T

    def rubbing(self, time):
        """Return what the friction of joints and hoses asks of the pose's six numbers."""
        pose, rate = self.pose(time), mpmath.matrix(difference(self.pose, time))
        p, at, turns = self.parameter, self.at(pose), self.turns(pose)
        slopes = [self.jacobian(of, pose) for of in (lambda at: at.alpha, lambda at: at.beta)]
        wrench = mpmath.zeros(6, 1)
        for slope, name in zip(slopes, ("r_alpha", "r_beta"), strict=True):
            rates = slope * rate
            wrench += p(name) * (slope.T * rates.apply(mpmath.sign))
            wrench += p("v_base") * (slope.T * rates)
        for j in STRUTS:
            first, y, z = self.frames[j]
            c, s = mpmath.cos(at.alpha[j]), mpmath.sin(at.alpha[j])
            second = plus([c * v for v in y], z, s)
            relative = turns.copy()
            for axis, slope in ((first, slopes[0]), (second, slopes[1])):
                relative -= mpmath.matrix(axis) * slope[j, :]
            wrench += p("v_platform") * (relative.T * (relative * rate))
        against = (turns * rate).apply(mpmath.sign)
        for k, name in enumerate(("phi", "theta", "psi")):
            wrench[k] += p(f"d_{'xyz'[k]}") * mpmath.sign(rate[k])
            against[k] *= p(f"d_{name}")
        return wrench + turns.T * against

    def jacobian(self, of, pose):
        """Return the derivatives of six numbers of a pose to the pose, (6, 6)."""
        columns = []
        for i in range(6):
            unit = [mpf(k == i) for k in range(6)]
            columns.append(difference(lambda s, u=unit: of(self.at(plus(pose, u, s))), mpf(0)))
        return mpmath.matrix(columns).T

    def condition(self, pose):
        """Return the condition number of G, rotations divided by the characteristic length."""
        slopes, twist = self.jacobian(lambda at: at.lengths, pose), mpmath.eye(6)
        twist[3:, :] = self.length * self.turns(pose)
        singular = mpmath.svd_r(slopes * twist**-1, compute_uv=False)
        return max(singular) / min(singular)

    def forces(self, time):
        """Return the forces of the actuators by Lagrange's equations and virtual work."""
        pose, rate = self.pose(time), difference(self.pose, time)
        wrench = difference(lambda t: self.momenta(self.pose(t), difference(self.pose, t)), time)
        for i in range(6):
            unit = [mpf(k == i) for k in range(6)]
            (slope,) = difference(
                lambda s, u=unit: [
                    self.kinetic(plus(pose, u, s), rate) - self.potential(plus(pose, u, s))
                ],
                mpf(0),
            )
            wrench[i] -= slope
        carried = self.jacobian(lambda at: at.lengths, pose).T ** -1
        speeds = difference(lambda t: self.at(self.pose(t)).lengths, time)
        accelerations = difference(lambda t: self.at(self.pose(t)).lengths, time, 2)
        lengths, p = self.at(pose).lengths, self.parameter
        moments = mpmath.matrix([p(f"m_{axis}") for axis in "xyz"])
        load = carried * (mpmath.matrix(wrench) - self.turns(pose).T * moments)
        for j in STRUTS:
            load[j] += p("m_drive") * accelerations[j] + p(f"o{j + 1}")
            (rest,) = self.point("cable", "rest_length")
            load[j] += p(f"k{j + 1}") * (lengths[j] - rest)
            pitch = self.constants.get("cogging.pitch")
            for order, letter in ((1, "c"), (2, "d")) if pitch is not None else ():
                angle = 2 * mpmath.pi * order * lengths[j] / pitch
                load[j] += p(f"{letter}s{j + 1}") * mpmath.sin(angle)
                load[j] += p(f"{letter}c{j + 1}") * mpmath.cos(angle)
        found = load + carried * self.rubbing(time)
        for j in STRUTS:
            sign, k = mpmath.sign(speeds[j]), j + 1
            found[j] += (
                p(f"r{k}") * sign + p(f"v{k}") * speeds[j] + p(f"mu{k}") * abs(load[j]) * sign
            )
            if "force_saturation.force" in self.constants:
                found[j] += (
                    p(f"sat{k}") * load[j] ** 3 / self.constants["force_saturation.force"] ** 2
                )
            size = abs(speeds[j])
            found[j] += p(f"a{k}") * size + (p(f"w{k}") + p(f"c{k}") * size) * size * speeds[j]
            (middle,) = self.point("position_friction", "length")
            along = p(f"rl{k}") * sign + p(f"vl{k}") * speeds[j]
            found[j] += (lengths[j] - middle) * along
            if "stribeck.velocity" in self.constants:
                ratio = speeds[j] / self.constants["stribeck.velocity"]
                found[j] += p(f"s{k}") * mpmath.exp(-(ratio**2)) * sign
        return list(found)

    def limited(self, time):
        """Return all that can be limited at a time, by the keys of the limits."""
        pose = self.pose(time)
        at = self.at(pose)

        def lengths(t):
            return self.at(self.pose(t)).lengths

        up = [row[2] for row in at.rotation]
        sideways = abs(at.rotation[0][2])
        return {
            "position": pose[:3],
            "rotation": pose[3:],
            "strut_length": at.lengths,
            "strut_speed": difference(lengths, time),
            "strut_acceleration": difference(lengths, time, 2),
            "strut_jerk": difference(lengths, time, 3),
            "alpha": at.alpha,
            "beta": at.beta,
            "tilt": [angle_between(up, [mpf(0), mpf(0), mpf(1)])],
            "attitude": [mpmath.sign(at.rotation[0][2]) * mpmath.asin(sideways)],
            "platform_joint_angle": [
                angle_between(u, turned(at.rotation, axis))
                for u, axis in zip(at.directions, self.axes, strict=True)
            ],
            "strut_clearance": [
                clearance(self.base[i], at.tips[i], self.base[j], at.tips[j])
                for i, j in itertools.combinations(STRUTS, 2)
            ],
            "jacobian_condition": [self.condition(pose)],
            "actuator_force": self.forces(time),
        }


class Pose:
    """What follows from a pose alone; lists of six."""

    def __init__(self, machine, pose):
        self._machine = machine
        self.rotation = rotation(pose)
        self.tips = [plus(pose[:3], turned(self.rotation, joint)) for joint in machine.joints]
        spans = [plus(tip, base, -1) for tip, base in zip(self.tips, machine.base, strict=True)]
        self.distances = [norm(span) for span in spans]
        self.directions = [
            [value / distance for value in span]
            for span, distance in zip(spans, self.distances, strict=True)
        ]

        self.origin = pose[:3]

    @cached_property
    def payload(self):
        own = turned(self.rotation, self._machine.point("payload", "x", "y", "z"))
        return plus(self.origin, own)

    @cached_property
    def compensated(self):
        """The distance of the points of a gravity compensation."""
        names = (tuple(f"{end}_{axis}" for axis in "xyz") for end in ("base", "platform"))
        base, own = (self._machine.point("gravity_compensation", *each) for each in names)
        return norm(plus(plus(self.origin, turned(self.rotation, own)), base, -1))

    @cached_property
    def alpha(self):
        pairs = zip(self.directions, self._machine.frames, strict=True)
        return [mpmath.atan2(-dot(u, frame[1]), dot(u, frame[2])) for u, frame in pairs]

    @cached_property
    def beta(self):
        pairs = zip(self.directions, self._machine.frames, strict=True)
        return [mpmath.asin(dot(u, frame[0])) for u, frame in pairs]

    @cached_property
    def lengths(self):
        """The actuators' coordinates: distances, less what a thread has turned."""
        machine = self._machine
        if machine.thread is None:
            return self.distances
        found = []
        for j in STRUTS:
            u = self.directions[j]
            lower = cross(machine.frames[j][0], u)
            upper = cross(turned(self.rotation, machine.thread[j]), u)
            angle = mpmath.atan2(dot(u, cross(lower, upper)), dot(lower, upper))
            found.append(self.distances[j] - machine.lead * angle / (2 * mpmath.pi))
        return found
