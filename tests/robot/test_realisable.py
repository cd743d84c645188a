"""Parameters that some bodies have, and the nearest ones: bodies as witnesses, and second ways."""

import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from expdesign.configuration import load_run
from expdesign.library import robot_files
from expdesign.mechanism.bodies import MachineBodies, RigidBody, pseudo_inertia
from expdesign.mechanism.nearest import NoBodiesError, Projection
from expdesign.robot import load_robot, robot_from

SYMMETRIC = load_robot("palida")


def _general():
    mapping = SYMMETRIC.description.description.model_dump(mode="json", by_alias=True)
    # Joints without any symmetry.
    joints = np.array(mapping["platform_joints"]) + np.linspace(-0.02, 0.03, 18).reshape(6, 3)
    mapping |= {"platform": "general", "platform_joints": joints.tolist()}
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


GENERAL = _general()
SEEDS = st.integers(0, 2**32 - 1)


def _body(rng, size, mass):
    """Return a body of 1 to 5 point masses: with few of them no inertia about some axis."""
    count = rng.integers(1, 6)
    places = rng.normal(size=(count, 3)) * size * np.exp(rng.normal())
    places *= rng.choice([1, 1e-3], size=3)  # rods and plates too
    masses = rng.dirichlet(np.ones(count)) * mass * np.exp(rng.normal())
    full = np.column_stack([places, np.ones(count)])
    return RigidBody.of_pseudo_inertia(full.T @ (masses[:, None] * full))


def machine(rng):
    ring, stator, platform = (_body(rng, 0.2, mass) for mass in (0.5, 5.0, 5.0))
    slider = _body(rng, 0.3, 2.0)
    down = np.diag([1.0, 1.0, -np.sign(slider.moment[2]), 1.0])  # towards the base
    slider = RigidBody.of_pseudo_inertia(down @ slider.pseudo_inertia @ down)
    return MachineBodies(ring, stator, slider, platform)


def made_by(robot, bodies, rng=None):
    """Return the parameters of bodies, the robot's where they say nothing."""
    made = bodies.parameters(robot.description.platform_joints)
    values = np.array(
        [made.get(n, v) for n, v in zip(robot.parameter_names, robot.parameters, strict=True)]
    )
    if rng is not None:
        friction = [n[0] in "rv" for n in robot.parameter_names]
        values[friction] *= rng.uniform(0, 2, sum(friction))
    return values


def assert_has(robot, bodies, values, tolerance=1e-11):
    """Every body's pseudo-inertia is positive semidefinite, and they make the parameters."""
    for name, body in vars(bodies).items():
        # By the definition, not by the way they were made.
        second = np.trace(body.inertia) / 2 * np.eye(3) - body.inertia
        whole = np.block([[second, body.moment[:, None]], [body.moment, np.array(body.mass)]])
        size = np.sqrt(np.maximum(np.diag(whole), 1e-9 * np.trace(whole) + 1e-300))
        least = np.linalg.eigvalsh(whole / np.outer(size, size))[0]
        assert least >= -tolerance, (name, least)
        assert np.linalg.eigvalsh(whole)[0] >= -tolerance * np.trace(whole)
    made = bodies.parameters(robot.description.platform_joints)
    units = [parameter.unit for parameter in robot.realisable.parameters]
    for name, value, unit in zip(robot.parameter_names, values, units, strict=True):
        largest = max(s for s, u in zip(robot.scales, units, strict=True) if u == unit)
        assert abs(made.get(name, value) - value) <= tolerance * largest, name
    among = robot.realisable
    assert np.all((values >= among.lower) & (values <= among.upper))


def metric(robot, rng, relative):
    """Return a covariance with correlations."""
    count = len(robot.scales)
    mixed = rng.normal(size=(count, 2 * count))
    mixed /= np.linalg.norm(mixed, axis=1)[:, None]
    std = relative * robot.scales * np.exp(rng.normal(size=count))
    return (mixed @ mixed.T) * np.outer(std, std)


def projection(robot, covariance, free=None):
    every = np.full(len(robot.scales), True)
    return Projection.by(covariance, robot.realisable, every if free is None else free)


@settings(deadline=None, max_examples=60)
@given(SEEDS)
def test_bodies_are_realisable_and_stay(seed):
    rng = np.random.default_rng(seed)
    robot = GENERAL
    values = made_by(robot, machine(rng), rng)
    robot = _scaled(robot, values)
    found = robot.realisable.bodies(values)
    assert found is not None
    assert_has(robot, found, values, tolerance=1e-10)
    nearest = projection(robot, metric(robot, rng, 0.1)).of(values)
    assert nearest.distance == 0
    np.testing.assert_array_equal(nearest.values, values)


def _scaled(robot, values):
    """Return the robot with other nominal values: scales are theirs."""
    about = robot.description
    named = dict(zip(robot.parameter_names, values.tolist(), strict=True))
    return replace(robot, description=replace(about, parameters=named))


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.sampled_from([1e-3, 1e-2, 1.0, 100.0]), st.booleans())
@example(5275, 100.0, False)  # p8 is 1e-13 of p6
def test_what_no_bodies_have_goes_to_the_nearest(seed, relative, general):
    rng = np.random.default_rng(seed)
    robot = GENERAL if general else SYMMETRIC
    covariance = metric(robot, rng, relative)
    start = robot.parameters * rng.choice([1.0, 0.0, -1.0] if relative >= 1 else [1.0])
    values = rng.multivariate_normal(start, covariance, method="cholesky")
    found = projection(robot, covariance)
    nearest = found.of(values)
    assert_has(robot, nearest.bodies, nearest.values)
    assert nearest.distance == pytest.approx(found.length(nearest.values - values))
    assert bool(nearest.active) == (nearest.distance > 0)
    assert nearest.distance - nearest.least <= 1e-4 * (1 + nearest.distance)
    # All parameters on the way to those of other bodies are realisable, too: none is nearer.
    root = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(robot.scales, robot.scales)))

    def whiten_rows(change):
        return root @ (change / robot.scales)

    gap = whiten_rows(values - nearest.values)
    others = [
        made_by(robot, machine(rng) if general else even_machine(rng), rng) for _ in range(20)
    ]
    for other in (*others, 0 * values, 2 * nearest.values):
        way = whiten_rows(other - nearest.values)
        share = np.clip(gap @ way / (way @ way + 1e-300), 0, 1)
        assert np.linalg.norm(gap - share * way) >= nearest.distance * (1 - 1e-4) - 1e-4


def even_machine(rng):
    """Return bodies whose platform has no lateral moments."""
    bodies = machine(rng)
    sides = [np.diag([x, y, 1.0, 1.0]) for x in (1, -1) for y in (1, -1)]
    whole = bodies.platform.pseudo_inertia
    even = sum(side @ whole @ side for side in sides) / 4
    return replace(bodies, platform=RigidBody.of_pseudo_inertia(even))


LOW = np.array(np.tril_indices(4)).T


class Factors:
    """Parameters of any numbers: Cholesky factors of the bodies, roots of friction."""

    def __init__(self, robot):
        self.robot = robot
        self.friction = np.flatnonzero([name[0] in "rv" for name in robot.parameter_names])
        zero = np.zeros((4, 4, 4))
        self.map = np.zeros((len(robot.scales), 4, 4, 4))
        for place in np.ndindex(4, 4, 4):
            one = zero.copy()
            one[place] = 1
            bodies = MachineBodies(*map(RigidBody.of_pseudo_inertia, one))
            made = bodies.parameters(robot.description.platform_joints)
            self.map[:, *place] = [made.get(name, 0.0) for name in robot.parameter_names]

    def factors(self, x):
        low = np.zeros((4, 4, 4))
        low[:, LOW[:, 0], LOW[:, 1]] = x[:40].reshape(4, 10)
        return low

    def values(self, x):
        low = self.factors(x)
        found = np.einsum("mbij,bik,bjk->m", self.map, low, low)
        found[self.friction] = self.robot.scales[self.friction] * x[40:] ** 2
        return found

    def slope(self, x):
        both = self.map + np.swapaxes(self.map, 2, 3)
        full = np.einsum("mbij,bjk->mbik", both, self.factors(x))
        slope = np.zeros((len(self.map), len(x)))
        slope[:, :40] = full[:, :, LOW[:, 0], LOW[:, 1]].reshape(len(slope), 40)
        slope[self.friction, 40 + np.arange(14)] = 2 * self.robot.scales[self.friction] * x[40:]
        return slope

    def start(self, bodies):
        whole = [b.pseudo_inertia + 1e-6 * np.eye(4) for b in vars(bodies).values()]
        return np.concatenate([np.linalg.cholesky(w)[*LOW.T] for w in whole] + [np.ones(14)])


@pytest.mark.parametrize(("seed", "relative"), [(0, 0.3), (1, 0.5), (2, 2.0)])
def test_a_search_without_constraints_finds_it_too(seed, relative):
    """Over the factors of the bodies, which may be anything: nothing but least squares."""
    rng = np.random.default_rng(seed)
    robot, factors = GENERAL, Factors(GENERAL)
    covariance = metric(robot, rng, relative)
    bodies = machine(rng)
    true = made_by(robot, bodies)
    values = rng.multivariate_normal(true, covariance, method="cholesky")
    values[robot.parameter_names.index("r2")] *= -1
    nearest = projection(robot, covariance).of(values)
    assert nearest.distance > 0.3
    root = np.linalg.inv(np.linalg.cholesky(covariance))

    def searched(begin):
        result = least_squares(
            lambda x: root @ (factors.values(x) - values),
            begin,
            lambda x: root @ factors.slope(x),
            max_nfev=150,
        )
        return np.sqrt(2 * result.cost)

    # From bodies elsewhere it comes near, where very heavy ones take long to be found; from the
    # nearest ones, moved a little, it finds nothing that is nearer.
    far = searched(factors.start(bodies) * rng.uniform(0.5, 1.5, 54))
    assert nearest.distance - 1e-5 <= far <= 1.5 * nearest.distance
    roots = np.sqrt(nearest.values[factors.friction] / robot.scales[factors.friction])
    near = factors.start(nearest.bodies)
    near[40:] = roots
    again = searched(near + 1e-3 * rng.normal(size=54))
    assert nearest.distance - 1e-5 <= again <= 1.01 * nearest.distance


def test_what_is_fixed_stays():
    robot, rng = GENERAL, np.random.default_rng(1)
    names = robot.parameter_names
    free = np.array([name not in ("p10", "p2", "r1", "Ixy") for name in names])
    covariance = metric(robot, rng, 0.3)
    for _ in range(10):
        values = rng.multivariate_normal(robot.parameters, covariance, method="cholesky")
        values = np.where(free, values, robot.parameters)
        nearest = projection(robot, covariance, free).of(values)
        np.testing.assert_array_equal(nearest.values[~free], values[~free])
        assert_has(robot, nearest.bodies, nearest.values, tolerance=1e-7)


def test_values_that_no_bodies_have_whatever_the_others_are():
    robot = SYMMETRIC
    values, names = robot.parameters.copy(), robot.parameter_names
    free = np.array([name not in ("p5", "p10") for name in names])
    covariance = np.diag((0.1 * robot.scales) ** 2)
    values[names.index("p10")] = -1.0
    with pytest.raises(NoBodiesError):
        projection(robot, covariance, free).of(values)
    # Any sliders have this p5, but for their mass.
    values[names.index("p10")] = 1.0
    assert projection(robot, covariance, free).of(values).distance > 0


def test_the_nearest_to_a_published_table():
    """PaLiDA's p2 exceeds p3 by rounding: they meet in the middle, nothing else moves."""
    robot = SYMMETRIC
    names, values = robot.parameter_names, robot.parameters
    assert robot.realisable.bodies(values) is None
    std = np.where([n in ("p2", "p3") for n in names], 1e-3, 1e-3 * robot.scales)
    nearest = projection(robot, np.diag(std**2)).of(values)
    changed = {n: v for n, v, was in zip(names, nearest.values, values, strict=True) if v != was}
    # p1 is what thin struts have at least, which 0.005 is.
    assert {"p2", "p3"} <= set(changed)
    assert changed["p2"] == pytest.approx(0.945, abs=1e-6)
    assert changed["p3"] == pytest.approx(0.945, abs=1e-6)
    np.testing.assert_allclose(nearest.values, values, atol=2.1e-3)
    assert nearest.distance == pytest.approx(2 * np.sqrt(2), rel=1e-4)


@pytest.mark.parametrize("name", robot_files())
def test_robots_that_ship(name):
    """But for PaLiDA's rounded table they are of bodies."""
    robot = load_robot(name)
    found = robot.realisable.bodies(robot.parameters)
    assert (found is None) == (name == "palida")
    assert found is None or assert_has(robot, found, robot.parameters) is None


@pytest.mark.parametrize("terms", [("struts", "actuator_friction"), ("rigid_platform", "cable")])
def test_struts_or_platform_alone(terms):
    mapping = SYMMETRIC.description.description.model_dump(mode="json", by_alias=True)
    kept = "p1 p2 p3 p4 p5" if terms[0] == "struts" else "p6 p7 p8 p9 p10"
    mapping["terms"] = [
        terms[0],
        {"cable": {"rest_length": 0.4}} if terms[1] == "cable" else terms[1],
    ]
    more = [
        f"{letter}{j}" for letter in ("rv" if terms[0] == "struts" else "") for j in range(1, 7)
    ]
    mapping["parameters"] = {
        **{name: mapping["parameters"][name] for name in (*kept.split(), *more)},
        **({f"k{j}": 10.0 for j in range(1, 7)} if terms[1] == "cable" else {}),
    }
    robot = robot_from(load_run({"name": "n", "robot": mapping}).robot)
    rng = np.random.default_rng(0)
    for relative in (0.01, 1.0):
        covariance = metric(robot, rng, relative)
        for _ in range(10):
            values = rng.multivariate_normal(robot.parameters, covariance, method="cholesky")
            nearest = projection(robot, covariance).of(values)
            made = nearest.bodies.parameters(robot.description.platform_joints)
            got = [
                made.get(n, v) for n, v in zip(robot.parameter_names, nearest.values, strict=True)
            ]
            np.testing.assert_allclose(got / robot.scales, nearest.values / robot.scales, atol=1e-9)
            for body in vars(nearest.bodies).values():
                whole = body.pseudo_inertia
                assert np.linalg.eigvalsh(whole)[0] >= -1e-11 * np.trace(whole)


def test_pseudo_inertia_there_and_back():
    rng = np.random.default_rng(3)
    body = _body(rng, 0.3, 2.0)
    back = RigidBody.of_pseudo_inertia(pseudo_inertia(body.mass, body.moment, body.inertia))
    for one, other in zip(vars(back).values(), vars(body).values(), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-15)


def test_a_panic_of_the_solver_is_a_failed_attempt(capfd):
    """Clarabel is written in Rust: a failed decomposition panics, with a trace on the screen."""
    PanicException = type("PanicException", (BaseException,), {})

    class Panicking:
        def update(self, b):
            pass

        def solve(self):
            os.write(2, b"thread panicked")
            raise PanicException("Eigval error")

    robot = load_robot("palida")
    values = robot.parameters * 1.3
    values[robot.parameter_names.index("p1")] = -1.0
    expected = projection(robot, np.diag((0.1 * robot.scales) ** 2)).of(values)
    broken = projection(robot, np.diag((0.1 * robot.scales) ** 2))
    broken._solvers[True] = Panicking()
    found = broken.of(values)
    np.testing.assert_allclose(found.values, expected.values, atol=1e-4 * robot.scales.max())
    assert found.distance == pytest.approx(expected.distance, rel=1e-4)
    assert "panicked" not in capfd.readouterr().err
