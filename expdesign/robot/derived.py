"""Derived quantities of a machine with their uncertainty: mass, centre, inertia, holding forces.

Each is a function of the parameters of the robot's terms: mass, centre and inertia of the platform
with the sliders' masses at its joints, those of the platform alone, the inertia of a motor, the
forces of the actuators at rest in the home pose. A quantity whose terms a robot lacks is left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.bodies import about_centre
from expdesign.mechanism.hexapod import COORDINATES, actuator_names
from expdesign.mechanism.terms.actuator_forces import DRIVE_MASS
from expdesign.mechanism.terms.rigid_platform import MASS, OF_A_BODY
from expdesign.robot.robot import Robot
from expdesign.runfolder import OpenNumber, described

NOISE = "noise"
"""Source of the random share."""
_DEPENDENT = 1e-5
"""Share of a gradient outside the identifiable combinations up to which it is a rounding error."""
GRAVITY_FORCE = "gravity_force_"
"""Prefix of the forces of the actuators at rest at home."""
ALONE = "platform_"
"""Prefix of the quantities of the platform without sliders and payload."""
_MOMENTS = {"xx": "Ixx", "yy": "Iyy", "zz": "Izz", "xy": "Ixy", "xz": "Ixz", "yz": "Iyz"}


@dataclass(frozen=True)
class DerivedQuantity:
    """One derived quantity."""

    name: str
    group: str
    """``"mass"``, ``"centre"``, ``"inertia"``, these after `ALONE`, ``"motor_inertia"`` or
    ``"gravity"``."""
    unit: str
    """SI."""


@dataclass(frozen=True, eq=False)
class DerivedQuantities:
    """The derived quantities of a robot, d of them."""

    quantities: tuple[DerivedQuantity, ...]
    values: Array
    """(d,), SI."""
    jacobian: Array
    """(d, m), derivatives with respect to the robot's parameters, SI."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(one.name for one in self.quantities)


def derived_quantities(robot: Robot, parameters: Array | None = None) -> DerivedQuantities:
    """Return the derived quantities at parameters, (m,), SI; by default the nominal ones.

    The quantities are ``mass``, ``centre_x`` … and ``inertia_xx`` … ``inertia_yz`` about the
    centre, in the platform frame (products as matrix entries); ``platform_mass`` … of the platform
    without sliders and payload if the robot file states these as bodies, since no motion separates
    them; ``motor_inertia`` of a drive with a screw or gear of known lead; ``gravity_force_1`` …
    ``gravity_force_6``, the forces of the actuators at rest in the home pose, without friction.
    Without a positive mass there is no centre.

    Examples
    --------
    >>> from expdesign.robot import load_robot
    >>> found = derived_quantities(load_robot("palida"))
    >>> found.names[:5]
    ('mass', 'centre_z', 'inertia_xx', 'inertia_yy', 'inertia_zz')
    """
    names = robot.parameter_names
    values = robot.parameters if parameters is None else parameters
    rows = [
        *_of_the_platform(names, values),
        *_of_the_platform_alone(robot, names, values),
        *_of_the_drives(robot, names, values),
        *_at_home(robot, values),
    ]
    return DerivedQuantities(
        tuple(quantity for quantity, _, _ in rows),
        np.array([value for _, value, _ in rows]),
        np.array([row for *_, row in rows]).reshape(len(rows), len(names)),
    )


def parameters_of(quantities: Collection[str]) -> frozenset[str]:
    """Return the parameters that derived quantities show by their names.

    >>> sorted(parameters_of({"mass", "motor_inertia"}))
    ['m_drive', 'p10']
    """
    found = {MASS} if "mass" in quantities else set()
    if any(belongs_to(one, "inertia") for one in quantities):
        found.update(OF_A_BODY.values())
    if "motor_inertia" in quantities:
        found.add(DRIVE_MASS)
    return frozenset(found)


def belongs_to(quantity: str, name: str) -> bool:
    """Return whether a quantity is the named one, or one of the named group.

    Examples
    --------
    >>> belongs_to("centre_x", "centre"), belongs_to("platform_centre_x", "centre")
    (True, False)
    """
    return f"{quantity}_".startswith(f"{name}_")


_Rows = Iterator[tuple[DerivedQuantity, float, Array]]


def _of_the_platform_alone(robot: Robot, names: tuple[str, ...], values: Array) -> _Rows:
    bodies = robot.description.description.bodies
    if bodies is None or not (bodies.slider or bodies.payload):
        return
    share = bodies.carried(robot.description.platform_joints)
    others = np.array([share[name] for name in OF_A_BODY.values()])
    for one, value, row in _of_the_platform(names, values, others):
        yield DerivedQuantity(ALONE + one.name, ALONE + one.group, one.unit), value, row


def _of_the_platform(names: tuple[str, ...], values: Array, others: Array | float = 0.0) -> _Rows:
    """Yield the quantities of the platform less the ten parameters of known bodies on it."""
    if MASS not in names:
        return
    own = np.array([[float(name == one) for name in names] for one in OF_A_BODY.values()])
    ten = own @ values - others * np.any(own, axis=1)
    yield DerivedQuantity("mass", "mass", "kg"), float(ten[0]), own[0]
    if not ten[0] > 0:
        return
    found, slope = about_centre(ten)
    moments = zip("xyz", ("sx", "sy", "sz"), strict=True)
    labels = [(f"centre_{axis}", "centre", "m", OF_A_BODY[key]) for axis, key in moments]
    labels += [
        (f"inertia_{axes}", "inertia", "kg m^2", OF_A_BODY[key]) for axes, key in _MOMENTS.items()
    ]
    rows = zip(labels, found.tolist(), slope @ own, strict=True)
    for (name, group, unit, parameter), value, row in rows:
        if parameter in names:
            yield DerivedQuantity(name, group, unit), value, row


def _of_the_drives(robot: Robot, names: tuple[str, ...], values: Array) -> _Rows:
    gear = robot.description.drive.geared
    if gear is None or DRIVE_MASS not in names:
        return
    row = np.array([float(name == DRIVE_MASS) for name in names]) * gear.torque_per_force**2
    yield DerivedQuantity("motor_inertia", "motor_inertia", "kg m^2"), float(row @ values), row


def _at_home(robot: Robot, values: Array) -> _Rows:
    rest = np.zeros(COORDINATES)
    rows = robot.regressor(robot.home, rest, rest)
    if not np.any(rows):
        return
    for name, row in zip(actuator_names(GRAVITY_FORCE), rows, strict=True):
        yield DerivedQuantity(name, "gravity", "N"), float(row @ values), row


@dataclass(frozen=True, eq=False)
class ErrorShares:
    """The covariance of n numbers by source: noise, and t inexact quantities of the machine."""

    random: Array
    """(n, n), due to noise, SI."""
    effects: Array
    """(n, t), effect of one standard deviation of every inexact quantity, SI."""
    sources: tuple[str, ...]
    """(t,), key of the tolerance of each."""

    def of(self, rows: Array) -> ErrorShares:
        """Return the shares of linear combinations, (d, n), of the numbers."""
        return ErrorShares(rows @ self.random @ rows.T, rows @ self.effects, self.sources)

    @property
    def covariance(self) -> Array:
        """(n, n), of all sources."""
        return self.random + self.effects @ self.effects.T

    @property
    def std_random(self) -> Array:
        """(n,), share of noise."""
        return np.sqrt(np.maximum(np.diag(self.random), 0.0))

    @property
    def std_systematic(self) -> Array:
        """(n,), share of the tolerances."""
        return np.linalg.norm(self.effects, axis=1)

    @property
    def std(self) -> Array:
        """(n,), of all sources."""
        return np.hypot(self.std_random, self.std_systematic)

    @property
    def by_source(self) -> dict[str, Array]:
        """Standard deviations, (n,), by key of the tolerance."""
        keys = np.array(self.sources)
        return {
            key: np.linalg.norm(self.effects[:, keys == key], axis=1)
            for key in dict.fromkeys(self.sources)
        }

    @property
    def largest_source(self) -> tuple[str, ...]:
        """(n,), the source of the largest share: ``noise`` or the key of a tolerance."""
        every = {NOISE: self.std_random, **self.by_source}
        most = np.argmax(np.array(list(every.values())), axis=0)
        return tuple(list(every)[place] for place in most)


@dataclass(frozen=True, kw_only=True)
class KnownQuantity:
    """A derived quantity with its standard deviation."""

    quantity: Annotated[
        str,
        described(
            "",
            "mass; centre_x …: centre in the platform frame; inertia_xx …: inertia about it, "
            "products as matrix entries (platform with the sliders' masses); platform_mass …: "
            "without sliders and payload, if the robot file has them as bodies; motor_inertia; "
            "gravity_force_1 …: forces of the actuators at rest at home, without friction",
        ),
    ]
    unit: Annotated[str, described("", "SI unit of value and standard deviations")]
    value: Annotated[OpenNumber, described("see unit", "value")]
    std: Annotated[OpenNumber, described("see unit", "standard deviation, of all sources")]
    std_random: Annotated[OpenNumber, described("see unit", "share of std that noise makes")]
    std_systematic: Annotated[
        OpenNumber, described("see unit", "share of std that the robot's tolerances make")
    ]
    rel_std_percent: Annotated[
        OpenNumber, described("%", "std over the value; empty for a centre or where that is 0")
    ]
    source: Annotated[str, described("", "largest contribution: noise, or the tolerance's key")]


def known_quantities(
    derived: DerivedQuantities, errors: ErrorShares, scales: Array, regrouping: Array | None
) -> Iterator[KnownQuantity]:
    """Yield the derived quantities that an experiment determines.

    Parameters
    ----------
    derived : DerivedQuantities
    errors : ErrorShares
        Of the robot's parameters, m; zero where they are exact.
    scales : (m,)
        Of the parameters, SI.
    regrouping : (m, m) or None
        Matrix from p to β for base parameters, to 0 for regrouped ones, else to p.
    """
    rows = derived.jacobian
    outside = np.zeros(rows.shape) if regrouping is None else (rows @ regrouping - rows) * scales
    known = np.linalg.norm(outside, axis=1) <= _DEPENDENT * np.linalg.norm(rows * scales, axis=1)
    shares = errors.of(rows)
    columns = zip(
        derived.quantities,
        derived.values.tolist(),
        shares.std.tolist(),
        shares.std_random.tolist(),
        shares.std_systematic.tolist(),
        shares.largest_source,
        known.tolist(),
        strict=True,
    )
    for one, value, std, random, systematic, source, determined in columns:
        if determined and std > 0:
            sized = value != 0 and one.group != "centre"
            yield KnownQuantity(
                quantity=one.name,
                unit=one.unit,
                value=value,
                std=std,
                std_random=random,
                std_systematic=systematic,
                rel_std_percent=100 * std / abs(value) if sized else np.nan,
                source=source,
            )
