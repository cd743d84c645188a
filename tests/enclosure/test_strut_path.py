"""Poses of given lengths of the struts: those that are proved, and those that are not."""

from functools import cache

import numpy as np
import pytest

from expdesign.enclosure.forward import StrutPath
from expdesign.enclosure.paths import between_rows
from expdesign.robot import load_robot

MIRRORED = np.array([1, 1, -1, -1, -1, 1])
"""Of a pose that has almost the same lengths, on the other side of the base."""


@cache
def robot():
    return load_robot("palida")


def away(times, seed=0):
    """Return poses, rates and accelerations of a way from rest at home, (N, 6) each."""
    size = np.random.default_rng(seed).uniform(-1, 1, 6) * [0.05, 0.05, 0.05, 0.2, 0.2, 0.2]
    turns = 2 * np.pi * times[:, None]
    shape = 1 - np.cos(turns), 2 * np.pi * np.sin(turns), (2 * np.pi) ** 2 * np.cos(turns)
    home, *rest = (part * size for part in shape)
    return robot().home + home, *rest


def path(guess=None, seed=0, step=5e-3, start=0.0):
    times = start + np.arange(0, 0.5 + step / 2, step)
    struts = robot().strut_motion(*away(times, seed))
    lengths = between_rows(times, struts.length, struts.length_rate)
    return StrutPath(robot(), lengths, guess or (lambda t: away(t, seed)[0]))


def cells(motion):
    return np.stack([motion.breaks[:-1], motion.breaks[1:]], axis=1)


def known(motion):
    models = motion.models(cells(motion))
    return np.all([np.isfinite(model.radius) for model in models[:18]], axis=0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("step", [5e-3, 2e-2, 0.1])
def test_the_machine_is_where_the_models_say(seed, step):
    motion = path(seed=seed, step=step)
    rng = np.random.default_rng(seed)
    edges = cells(motion)
    parts = rng.uniform(0, 1, (len(edges), 2))
    edges = edges[:, :1] + np.sort(parts, axis=1) * np.diff(edges, axis=1)
    tau = rng.uniform(-1, 1, len(edges))
    times = edges.mean(axis=1) + tau * np.diff(edges, axis=1)[:, 0] / 2

    models = motion.models(edges)
    values = np.stack([model.at(tau) for model in models[:18]], axis=1)
    radius = np.stack([model.radius for model in models[:18]], axis=1)

    speed = motion.lengths.derivative
    wanted = [part.over(np.stack([times, times], axis=1)) for part in (motion.lengths, speed)]
    acceleration = speed.derivative.over(np.stack([times, times], axis=1))
    length, rate, second = (
        np.stack([model.coefficients[0] for model in part], axis=1)
        for part in (*wanted, acceleration)
    )
    pose = robot().forward_kinematics(length, away(times, seed)[0])
    found = [pose]
    jacobian = robot().length_jacobian(pose)
    found.append(np.linalg.solve(jacobian, rate[:, :, None])[:, :, 0])
    rest = robot().strut_motion(pose, found[1], np.zeros_like(pose)).length_acceleration
    found.append(np.linalg.solve(jacobian, (second - rest)[:, :, None])[:, :, 0])
    # What is computed with numbers has about twelve digits.
    computed = np.concatenate(found, axis=1)
    assert np.all(np.isfinite(radius))
    assert np.all(np.abs(values - computed) <= radius + 1e-10 * (1 + np.abs(computed)))
    assert np.max(radius[:, :6]) < 1e-8


def test_another_way_to_assemble_the_machine_is_not_taken_for_it():
    mirrored = path(guess=lambda t: away(t)[0] * MIRRORED)
    there = robot().forward_kinematics(
        robot().inverse_kinematics(robot().home), robot().home * MIRRORED
    )

    assert np.max(np.abs(there - robot().home)) > 0.1
    assert np.all(known(path()))
    assert not np.any(known(mirrored))


def test_what_comes_behind_a_jump_to_another_way_is_not_known():
    def guess(times):
        return np.where(times[:, None] < 0.25, away(times)[0], away(times)[0] * MIRRORED)

    motion = path(guess=guess)
    found, edges = known(motion), cells(motion)

    assert np.all(found[edges[:, 1] < 0.24])
    assert not np.any(found[edges[:, 0] > 0.26])


def test_a_path_that_does_not_begin_at_home_is_not_known():
    assert not np.any(known(path(start=0.2)))


def test_a_part_of_a_cell_tells_no_less_than_the_cell():
    motion = path(step=2e-2)
    edges = cells(motion)
    middle = edges.mean(axis=1, keepdims=True)
    whole, parts = motion.models(edges), motion.models(middle + (edges - middle) / 16)

    for one, other in zip(whole[:18], parts[:18], strict=True):
        low, high = one.bounds()
        inner_low, inner_high = other.bounds()
        assert np.all(inner_low <= high)
        assert np.all(inner_high >= low)
        assert np.median(inner_high - inner_low) < np.median(high - low)
