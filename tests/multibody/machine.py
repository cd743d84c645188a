"""PaLiDA as nineteen rigid bodies for MuJoCo: masses, centres, inertia tensors, joints, friction.

The joints' places come from the robot file, everything else is stated here. What the model calls
p1 … p10 follows from the bodies by the formulas of docs/model.md, and is fitted to nothing.
"""

from dataclasses import dataclass

import numpy as np

STRUTS = 6


@dataclass(frozen=True)
class Geometry:
    """Where the joints are [m]: base frame and platform frame, (6, 3) each; pose at home, (6,).

    `gravity` is (3,) [m/s²].
    """

    base_joints: np.ndarray
    platform_joints: np.ndarray
    home: np.ndarray
    gravity: np.ndarray

    @classmethod
    def of(cls, robot):
        """Take them from a robot file that was read."""
        about = robot.description
        values = (about.base_joints, about.platform_joints, robot.home, about.gravity)
        return cls(*(np.array(value, dtype=float) for value in values))


@dataclass(frozen=True)
class Body:
    """A rigid body: mass [kg], centre [m] and the inertia's diagonal about the centre [kg m²]."""

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]

    def about_origin(self):
        """Return the inertia's diagonal about the frame's origin [kg m²]: parallel axes."""
        squares = np.square(self.centre)
        return np.array(self.inertia) + self.mass * (squares.sum() - squares)


@dataclass(frozen=True)
class Bodies:
    """What moves, and its friction; the struts are alike but for the actuators' friction.

    Frames of a strut: x the first cardan axis at rest, y the second one, z along the strut. Ring
    and stator have their origin in the cardan's centre A, the slider in its joint B with the
    platform.
    """

    ring: Body = Body(0.6, (0, 0, 0), (0.0019, 0.0012, 0.0014))
    stator: Body = Body(9.0, (0, 0, 0.064), (0.050, 0.049, 0.0028))
    slider: Body = Body(2.5, (0, 0, -0.52), (0.175, 0.1751, 0.0003))
    platform: Body = Body(1.3, (0, 0, 0.106), (0.0092, 0.0088, 0.0146))
    cardan_friction: tuple[float, ...] = (0.45, 0.80)
    """Dry, about the first and the second axis [N m]."""
    dry_friction: tuple[float, ...] = (11.5, 2.8, 14.0, 5.2, 3.3, 5.6)
    """Of the actuators [N]."""
    viscous_friction: tuple[float, ...] = (21.0, 20.0, 14.5, 25.0, 26.5, 23.0)
    """Of the actuators [N s/m]."""
    payload: str = ""
    """A body that is fixed to the platform, as MuJoCo takes it; `parameters` leaves it out."""

    def parameters(self, platform_joints):
        """Return p1 … p10, r_alpha, r_beta, r1 … r6, v1 … v6 of the bodies, (24,), SI.

        They are the machine's when all centres are on the axes z.
        """
        stator, slider = self.stator.about_origin(), self.slider.about_origin()
        squares = np.square(platform_joints).sum(axis=0)
        lumped = self.platform.about_origin() + self.slider.mass * (squares.sum() - squares)
        along_strut = stator[2] + slider[2]
        heights = self.slider.mass * np.sum(platform_joints[:, 2])
        rigid = (
            self.ring.inertia[0] + along_strut,
            stator[0] + slider[0] - along_strut,
            stator[1] + slider[1],
            self.stator.mass * self.stator.centre[2],
            self.slider.mass * self.slider.centre[2],
            *lumped,
            self.platform.mass * self.platform.centre[2] + heights,
            self.platform.mass + STRUTS * self.slider.mass,
        )
        friction = (*self.cardan_friction, *self.dry_friction, *self.viscous_friction)
        return np.array([*rigid, *friction])


def mjcf(geometry, bodies):
    """Return the machine in MuJoCo's format: a tree, and six constraints that close its loops at B.

    Degrees of freedom: six of the platform, x, y, z, then turns about its moving x, y and z; then
    three of each strut: first and second cardan axis, length.
    """
    platform = "".join(
        f'<joint type="{kind}" axis="{axis}"/>'
        for kind in ("slide", "hinge")
        for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    sites = "".join(
        f'<site name="platform{j}" pos="{_text(joint)}"/>'
        for j, joint in enumerate(geometry.platform_joints)
    )
    struts = "".join(_strut(geometry, bodies, j) for j in range(STRUTS))
    loops = "".join(f'<connect site1="strut{j}" site2="platform{j}"/>' for j in range(STRUTS))
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{_text(geometry.gravity)}"/>'
        f"<worldbody><body>{platform}{_inertial(bodies.platform)}{sites}{bodies.payload}</body>"
        f"{struts}</worldbody>"
        f"<equality>{loops}</equality></mujoco>"
    )


def _strut(geometry, bodies, j):
    # The first axis is horizontal and radial; the strut at home tells where x and y are.
    base = geometry.base_joints[j]
    first = np.array([base[0], base[1], 0]) / np.hypot(base[0], base[1])
    at_home = geometry.home[:3] + geometry.platform_joints[j] - base
    along = at_home - first * (first @ at_home)
    second = np.cross(along / np.linalg.norm(along), first)
    first_dry, second_dry = bodies.cardan_friction
    return (
        f'<body pos="{_text(base)}" xyaxes="{_text([*first, *second])}">'
        f"{_inertial(bodies.ring)}"
        f'<joint type="hinge" axis="1 0 0" frictionloss="{first_dry!r}"/>'
        f"<body>{_inertial(bodies.stator)}"
        f'<joint type="hinge" axis="0 1 0" frictionloss="{second_dry!r}"/>'
        f'<body>{_inertial(bodies.slider)}<site name="strut{j}"/>'
        f'<joint type="slide" axis="0 0 1" frictionloss="{bodies.dry_friction[j]!r}" '
        f'damping="{bodies.viscous_friction[j]!r}"/></body></body></body>'
    )


def _inertial(body):
    return (
        f'<inertial pos="{_text(body.centre)}" mass="{body.mass!r}" '
        f'diaginertia="{_text(body.inertia)}"/>'
    )


def _text(numbers):
    return " ".join(repr(float(number)) for number in numbers)
