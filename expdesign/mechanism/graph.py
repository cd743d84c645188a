"""The symbolic graph of a 6-UPS hexapod: built once, evaluated by everything else.

Inputs are the state (pose, rate, acceleration), the machine (its geometry and the constants of its
terms), the parameters and the signs of dry friction. Design, recheck, simulation and estimation
take their functions from here; only the friction signs differ between them (`Friction`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from types import MappingProxyType

import casadi as ca

from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.strut import (
    GeometrySymbols,
    StrutKinematics,
    ThreadTurn,
    angular_acceleration,
    angular_velocity,
    rotation_matrix,
    torque_wrench,
)
from expdesign.mechanism.term import Friction, Instant, Term, parameters_of, smooth_sign

_LOADED_STEPS = 4
"""Newton steps for friction that depends on the load: each error is the share μ of the previous
one, and zero once no load changes its sign."""


class HexapodGraph:
    """Symbols and expressions of one instant, columns but the regressor. SI units and radians."""

    def __init__(
        self, terms: tuple[Term, ...], *, open_inverse: bool = False, open_load: bool = False
    ) -> None:
        self.pose, self.rate, self.acceleration = (
            ca.SX.sym(name, COORDINATES) for name in ("pose", "rate", "acceleration")
        )
        self.turning = any(term.turning for term in terms)
        self.geometry = GeometrySymbols(turning=self.turning)
        count = len(parameters_of(terms))
        # (c, 1), of the terms in their order
        self.constants = ca.SX.sym("constant", sum(len(term.constants) for term in terms))
        # (m, 1), parameters from which a term may know the load of the actuators
        self.nominal = ca.SX.sym("nominal", count)
        self.parameters = ca.SX.sym("p", count)
        # Those rates whose signs the terms use; (s, 1) signs, six of each
        self.rates = tuple(dict.fromkeys(rate for term in terms for rate in term.rates))
        self.signs = ca.SX.sym("sign", ACTUATORS * len(self.rates))
        # Of the smoothed signs, m/s
        self.width = ca.SX.sym("width")
        # Characteristic length that makes rotations comparable with translations, m
        self.length_scale = ca.SX.sym("characteristic_length")

        angles, angle_rates = self.pose[3:], self.rate[3:]
        rotation = rotation_matrix(angles)
        omega = angular_velocity(angles, angle_rates)
        domega = angular_acceleration(angles, angle_rates, self.acceleration[3:])
        arms = rotation @ self.geometry.platform_joints
        struts = []
        for j in range(ACTUATORS):
            arm = arms[:, j]
            turning = ca.cross(omega, arm)
            struts.append(
                StrutKinematics(
                    self.geometry.base_joints[:, j],
                    self.geometry.cardan_frames[j],
                    self.pose[:3] + arm,
                    self.rate[:3] + turning,
                    self.acceleration[:3] + ca.cross(domega, arm) + ca.cross(omega, turning),
                )
            )
        # Wrenches of a unit force between the joints of each strut; l̇ of the twist by their rows.
        self._stretching = transposed = ca.horzcat(
            *(
                ca.vertcat(strut.direction, ca.cross(arms[:, j], strut.direction))
                for j, strut in enumerate(struts)
            )
        )
        coordinates = [
            _column(struts, name) for name in ("length", "length_rate", "length_acceleration")
        ]
        if self.turning:
            twist = ca.vertcat(self.rate[:3], omega)
            turns, wrenches = self._turns(struts, arms, rotation, twist)
            coordinates = [a - b for a, b in zip(coordinates, turns, strict=True)]
            transposed = transposed - wrenches
        # Gᵀ, of the coordinates q of the actuators (q̇ = G V), has the columns `transposed`.
        scale = ca.vertcat(ca.SX.ones(3), ca.repmat(1 / self.length_scale, 3, 1))
        # Quantities that depend on no parameter, by name (see `quantities`)
        self.kinematic = MappingProxyType(
            {
                "position": self.pose[:3],
                "rotation_angles": angles,
                "rotation_matrix": rotation,
                "platform_rate": ca.vertcat(self.rate[:3], omega),
                "strut_length": coordinates[0],
                "strut_speed": coordinates[1],
                "strut_acceleration": coordinates[2],
                **{
                    name: _column(struts, name)
                    for name in ("alpha", "beta", "sin_beta", "alpha_rate", "beta_rate")
                },
                "strut_direction": ca.horzcat(*(strut.direction for strut in struts)),
                "base_joints": self.geometry.base_joints,
                "platform_joints": ca.repmat(self.pose[:3], 1, ACTUATORS) + arms,
                "platform_joint_axes": rotation @ self.geometry.platform_joint_axes,
                "inverse_jacobian": (ca.diag(scale) @ transposed).T,
            }
        )
        signs = ca.vertsplit(self.signs, ACTUATORS) if self.rates else []
        instant = Instant(
            kinematic=self.kinematic,
            struts=tuple(struts),
            arms=arms,
            acceleration=self.acceleration[:3],
            angular_velocity=omega,
            angular_acceleration=domega,
            gravity=self.geometry.gravity,
            signs=dict(zip(self.rates, signs, strict=True)),
            constants={},
            load=ca.SX.zeros(ACTUATORS),
        )
        # (6, 6), Gᵀ, and its inverse, which takes wrenches to the actuators: an input where it is
        # found by another way
        self.transposed = transposed
        self.inverse_jacobian_transposed = (
            ca.SX.sym("carried", ACTUATORS, ACTUATORS) if open_inverse else inverse(transposed)
        )
        # (6, 1), the load of the actuators where it is an input, found by another way, and (m,)
        # which parameters are in it
        self.load, self._open_load = ca.SX.sym("load", ACTUATORS), open_load
        self.loading: tuple[bool, ...] = ()
        self._struts, self._arms = struts, arms
        # (6, m) wrenches on the platform and (12, m) torques about the cardan axes, (6, m) wrenches
        # that both make together, and (6, m) forces along the struts
        self._direct, self._torques, self._wrench, self._along = self._columns(terms, instant)
        # (6, m), A with `signs` in place of the sign functions
        self.regressor = ca.cse(
            ca.densify(self.inverse_jacobian_transposed @ self._wrench + self._along)
        )

    def _turns(
        self, struts: list[StrutKinematics], arms: ca.SX, rotation: ca.SX, twist: ca.SX
    ) -> tuple[list[ca.SX], ca.SX]:
        """Return by how much the halves have moved on their threads, (6, 1), and twice its rate.

        With the wrenches (6, 6) of forces that move them apart by turning.
        """
        geometry, pitch = self.geometry, self.geometry.lead / (2 * ca.pi)
        axes = rotation @ geometry.platform_cardan_axes
        threads = [
            ThreadTurn(strut, arms[:, j], geometry.cardan_frames[j][:, 0], axes[:, j])
            for j, strut in enumerate(struts)
        ]
        wrenches = pitch * ca.horzcat(*(thread.wrench for thread in threads))
        rates = wrenches.T @ twist
        moving, changing = (
            ca.vertcat(self.pose, self.rate),
            ca.vertcat(self.rate, self.acceleration),
        )
        angles = pitch * _column(threads, "angle")
        return [angles, rates, ca.jtimes(rates, moving, changing)], wrenches

    def _wrench_of_torques(self, torques: ca.SX) -> ca.SX:
        """Return the wrenches (6, k) of torques (12, k) about the cardan axes of all struts."""
        wrench = ca.SX.zeros(ACTUATORS, torques.shape[1])
        for j, strut in enumerate(self._struts):
            wrench += torque_wrench(strut, self._arms[:, j], torques[2 * j : 2 * j + 2, :])
        return wrench

    def _columns(self, terms: tuple[Term, ...], instant: Instant) -> list[ca.SX]:
        """Return the parts of the columns of A."""
        found = [ca.SX(count * ACTUATORS, 0) for count in (1, 2, 1, 1)]
        load = self.load if self._open_load else ca.SX.zeros(ACTUATORS)
        loading: tuple[bool, ...] = ()
        values = iter(ca.vertsplit(self.constants))
        constants: dict[str, dict[str, ca.SX]] = {"": {}}
        for term in terms:
            constants[term.name] = {constant.name: next(values) for constant in term.constants}
            own = constants[term.name] | constants[term.constants_of]
            signs = {rate: instant.signs[rate] for rate in term.rates}
            columns = term.columns(replace(instant, signs=signs, constants=own, load=load))
            none = ca.SX(ACTUATORS, len(term.parameters))
            direct = none if columns.wrench is None else columns.wrench
            torques = ca.vertcat(none, none) if columns.torques is None else columns.torques
            along = none if columns.along is None else columns.along
            if columns.between is not None and self.turning:
                direct = direct + self._stretching @ columns.between
            elif columns.between is not None:
                along = columns.between if columns.along is None else along + columns.between
            wrench = (
                direct if columns.torques is None else direct + self._wrench_of_torques(torques)
            )
            own_parts = (direct, torques, wrench, along)
            if not (term.is_friction or self._open_load):
                first = found[0].shape[1]
                own_nominal = self.nominal[first : first + none.shape[1]]
                load += (self.inverse_jacobian_transposed @ wrench + along) @ own_nominal
            if any(ca.depends_on(part, self.load) for part in own_parts):
                if self.loading and any(loading[len(self.loading) :]):
                    raise ValueError(f"the load of {term.name} is not that of the terms before it")
                self.loading = loading
            loading += (not term.is_friction,) * len(term.parameters)
            found = [ca.horzcat(*pair) for pair in zip(found, own_parts, strict=True)]
        self.loading += (False,) * (len(loading) - len(self.loading))
        return found

    @property
    def state(self) -> ca.SX:
        """(18, 1): pose, rate and acceleration."""
        return ca.vertcat(self.pose, self.rate, self.acceleration)

    @property
    def machine(self) -> ca.SX:
        """(g + c + m, 1): inputs of A other than the state; one graph serves every robot."""
        return ca.vertcat(self.geometry.vector, self.constants, self.nominal)

    @property
    def sliding(self) -> ca.SX:
        """(s, 1): the rates of the terms' signs."""
        return _stack_columns(self.kinematic[rate.quantity] for rate in self.rates)

    @cached_property
    def jumping(self) -> tuple[bool, ...]:
        """True for each column with a sign in it: it jumps when a rate changes sign."""
        slope = ca.jacobian(ca.sum1(self.regressor).T, self.signs)
        return tuple(slope[k, :].nnz() > 0 for k in range(slope.shape[0]))

    @cached_property
    def loaded(self) -> bool:
        """True when a term depends on the load of the actuators: A is that at one load."""
        return bool(ca.depends_on(self.regressor, self.nominal))

    def regressor_with(self, friction: Friction) -> ca.SX:
        """Return A (6, m) with the friction signs of the kind asked for."""
        if friction is Friction.HELD:
            return self.regressor
        return ca.cse(self.with_signs(self.regressor, friction))

    def force_with(self, friction: Friction) -> ca.SX:
        """Return A p (6, 1), p being `parameters`, in two thirds of the instructions of A."""
        wrench, along = self.wrench_and_direct_forces(friction)
        return ca.cse(ca.densify(self.inverse_jacobian_transposed @ wrench + along))

    def wrench_and_direct_forces(self, friction: Friction) -> tuple[ca.SX, ca.SX]:
        """Return w and f of A p = G⁻ᵀ w + f: wrench on the platform, forces of the actuators.

        Torques and wrenches are summed up before they are mapped to the actuators.
        """
        direct, torques, along = (
            self.with_signs(part, friction) @ self.parameters
            for part in (self._direct, self._torques, self._along)
        )
        return direct + self._wrench_of_torques(torques), along

    def force_slope(self, friction: Friction, by: ca.SX) -> ca.SX:
        """Return ∂(A p)/∂by, (6, n), of numbers that A depends on, such as the state.

        With Gᵀ f = w for the wrench w that the actuators carry: Gᵀ df = dw − dGᵀ f. Nothing is
        differentiated through the factorisation of Gᵀ, which halves the instructions.
        """
        wrench, along = self.wrench_and_direct_forces(friction)
        carried_force = ca.SX.sym("carried_force", ACTUATORS)
        slope = self.inverse_jacobian_transposed @ ca.jacobian(
            ca.cse(wrench - self.transposed @ carried_force), by
        )
        slope = ca.substitute(
            slope, carried_force, ca.densify(self.inverse_jacobian_transposed @ wrench)
        )
        return ca.densify(slope + ca.jacobian(along, by))

    def acceleration_with(self, friction: Friction, forces: ca.SX) -> ca.SX:
        """Return the λ̈ (6, 1) that forces of the actuators (6, 1) make: the forward dynamics.

        The wrench that the bodies ask for is M λ̈ + h, and the actuators' is Gᵀ Q: one system of
        six equations, without G⁻ᵀ. Where friction depends on the load, and the load on λ̈, they are
        linear piece by piece, and Newton's steps go on until the pieces are known.
        """
        wrench, along = self.wrench_and_direct_forces(friction)
        lacking = wrench + self.transposed @ (along - forces)
        slope = ca.jacobian(lacking, self.acceleration)
        found = ca.SX.zeros(COORDINATES)
        for _ in range(_LOADED_STEPS if self.loaded else 1):
            here = ca.substitute([lacking, slope], [self.acceleration], [found])
            found = found - ca.solve(here[1], here[0])
        return ca.cse(ca.densify(found))

    def with_signs(self, columns: ca.SX, friction: Friction) -> ca.SX:
        """Return expressions with the signs of dry friction that are asked for."""
        if friction is Friction.HELD:
            return columns
        signs = ca.sign(self.sliding)
        if friction is Friction.SMOOTH:
            # One width in m/s for the actuators; a passive joint slides by the angle that a
            # strut of the present length turns, so that its width is the same at the strut's end.
            arm = _stack_columns(
                ca.SX.ones(ACTUATORS) if rate.arm is None else self.kinematic[rate.arm]
                for rate in self.rates
            )
            per_width = ca.sqrt(1 / self.width**2)  # see StrutKinematics
            signs = smooth_sign(self.sliding * arm * per_width)
        return ca.substitute(columns, self.signs, signs)

    def quantities(self, friction: Friction) -> Mapping[str, ca.SX]:
        """Return all named quantities that limits may bound.

        ``position`` (3), ``rotation_angles`` (3), ``rotation_matrix`` (3, 3), ``platform_rate`` (6:
        velocity of the TCP and angular velocity), ``strut_length`` (the actuator's coordinate: the
        distance of the joints, but on a thread),
        ``strut_speed``, ``strut_acceleration``, ``alpha``, ``beta``, ``sin_beta``,
        ``alpha_rate``, ``beta_rate`` (6 each), ``strut_direction`` (3, 6), ``base_joints``,
        ``platform_joints`` (3, 6, base frame), ``platform_joint_axes`` (3, 6, base frame),
        ``inverse_jacobian`` (6, 6, rotations divided by the characteristic length), ``jacobian``,
        its inverse, and ``actuator_force`` (6).
        """
        scale = ca.vertcat(ca.SX.ones(3), ca.repmat(self.length_scale, 3, 1))
        return MappingProxyType(
            {
                **self.kinematic,
                "jacobian": ca.diag(scale) @ self.inverse_jacobian_transposed.T,
                "actuator_force": self.force_with(friction),
            }
        )

    def inputs(self, friction: Friction) -> list[ca.SX]:
        """Return state, machine, parameters, characteristic length and the friction's input."""
        extra = {Friction.SMOOTH: self.width, Friction.HELD: self.signs}
        own = extra.get(friction, ca.SX(0, 1))
        return [self.state, self.machine, self.parameters, self.length_scale, own]


@cache
def hexapod_graph(
    terms: tuple[Term, ...] = (), *, open_inverse: bool = False, open_load: bool = False
) -> HexapodGraph:
    """Build the graph of these terms, without any: that of the kinematics alone; cached.

    With an open inverse, G⁻ᵀ is an input of the graph (`inverse_jacobian_transposed`) instead of
    an expression; with an open load that of the actuators, `load`.
    """
    return HexapodGraph(terms, open_inverse=open_inverse, open_load=open_load)


def _column(struts: Sequence[StrutKinematics | ThreadTurn], name: str) -> ca.SX:
    return ca.vertcat(*(getattr(strut, name) for strut in struts))


def _stack_columns(parts: Iterable[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *parts)


def inverse(matrix: ca.SX) -> ca.SX:
    """Return the inverse of a matrix (n, n), as accurate as its condition allows.

    By QR factorisation, as `ca.inv` does (modified Gram–Schmidt: Golub, Van Loan 2013, sec. 5.2.8),
    but with n divisions instead of about 2 n²: products with reciprocal square roots are cheaper.
    """
    columns = ca.horzsplit(matrix)
    directions: list[ca.SX] = []
    shares: list[list[ca.SX]] = []
    per_length: list[ca.SX] = []
    for column in columns:
        rest, own = column, list[ca.SX]()
        for direction in directions:
            own.append(ca.dot(direction, rest))
            rest = rest - own[-1] * direction
        per_length.append(ca.sqrt(1 / ca.dot(rest, rest)))
        directions.append(rest * per_length[-1])
        shares.append(own)
    rows: list[ca.SX] = []
    for i in reversed(range(len(columns))):
        row = directions[i].T
        for k, later in enumerate(reversed(rows), start=i + 1):
            row = row - shares[k][i] * later
        rows.append(row * per_length[i])
    return ca.vertcat(*reversed(rows))
