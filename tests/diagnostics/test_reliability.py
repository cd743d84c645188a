"""Effects that no test would find: their size, and what they do to the parameters."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Status
from estimation.diagnostics.hypothesis import evaluate_hypothesis
from estimation.diagnostics.reliability import (
    UndetectedEffect,
    changes_in_words,
    join_recordings,
    undetected_std,
)
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import robot_from
from expdesign.robot.derived import derived_quantities
from tests.diagnostics.conftest import Laboratory


@pytest.fixture(scope="module")
def lab():
    return Laboratory(samples=200, periods=4)


@pytest.fixture(scope="module", params=["ml", "ls"])
def found(lab, request):
    """Return an estimator and what it cannot see in a sound recording, by family and place."""
    experiment = lab.experiment(lab.measure(1), lab.noise)
    estimate = lab.estimate([experiment], request.param)
    effects = diagnose(lab.robot, [experiment], lab.knowledge, estimate).undetected
    return request.param, {(one.kind, one.parameter, one.strut): one for one in effects}


@pytest.mark.parametrize(("kind", "strut"), [("force_offset", 0), ("gain", 4)])
def test_an_effect_of_that_size_moves_the_estimate_by_that_much(lab, found, kind, strut):
    """The same noise with the effect and with its opposite, estimated anew."""
    estimator, effects = found
    effect = effects[kind, "", strut]
    data = lab.measure(1)
    estimates = []
    for size in (effect.size, -effect.size):
        forces = data.forces.copy()
        forces[:, strut] += size if kind == "force_offset" else size * forces[:, strut]
        experiment = lab.experiment(replace(data, forces=forces), lab.noise)
        estimates.append(lab.estimate([experiment], estimator))
    moved = np.abs(estimates[0].values - estimates[1].values) / 2 / estimates[0].std
    names = lab.knowledge.names
    expected = np.array([effect.shifts[name] for name in names]) / estimates[0].std
    np.testing.assert_allclose(moved, expected, atol=0.1 + 0.03 * np.max(expected))
    assert names[int(np.argmax(expected))] == effect.worst
    mass, centre = (
        [derived_quantities(lab.robot, one.values).values[k] for one in estimates]
        for k in map(derived_quantities(lab.robot).names.index, ("mass", "centre_z"))
    )
    assert abs(mass[0] - mass[1]) / 2 == pytest.approx(effect.derived["mass"], rel=0.1, abs=0.02)
    own = abs(centre[0] - centre[1]) / 2
    assert own == pytest.approx(effect.derived["centre_z"], rel=0.1, abs=1e-4)
    assert effect.sigmas == pytest.approx(np.max(expected), rel=0.05)


@pytest.mark.parametrize("kind", ["force_offset", "drive_inertia"])
def test_its_own_test_finds_it_in_four_of_five_recordings(twin, kind):
    lab = twin.lab
    estimate = lab.estimate([twin.experiment], "ml")
    effects = diagnose(lab.robot, [twin.experiment], lab.knowledge, estimate).undetected
    family = next(one for one in twin.families(held_out=False) if one.kind == kind)
    name, strut = family.labels[0]
    (effect,) = (e for e in effects if (e.kind, e.parameter, e.strut) == (kind, name, strut))
    rng, hits, count = np.random.default_rng(3), 0, 60
    for _ in range(count):
        drawn = twin.draw(rng, "ml")
        disturbed = replace(
            drawn, forces=drawn.forces + effect.size * family.columns.forces[:, :, 0]
        )
        projection = twin.system(disturbed).solution.project(family.columns)
        test = evaluate_hypothesis(projection.conditional_on(()), family, 0)
        hits += bool(test.log_p[0] < test.limits[0])
    assert hits / count == pytest.approx(0.8, abs=0.15)


def test_a_joint_moves_no_parameter_by_more_in_any_direction(lab):
    """Three coordinates: random displacements that the test detects in four of five cases."""
    experiment = lab.experiment(lab.measure(1), lab.noise)
    estimate = lab.estimate([experiment], "ml")
    diagnosis = diagnose(lab.robot, [experiment], lab.knowledge, estimate)
    (recording,) = diagnosis.recordings
    joint = next(one for one in recording.reliability if one.key[:3] == ("joint", "platform", 2))
    (effect,) = (
        one
        for one in diagnosis.undetected
        if (one.kind, one.parameter, one.strut) == ("joint", "platform", 2)
    )
    directions = np.random.default_rng(1).standard_normal((4000, 3))
    information = np.linalg.inv(joint.fit.covariance)
    sizes = np.einsum("di,ij,dj->d", directions, information, directions)
    changes = directions * np.sqrt(joint.noncentrality / sizes)[:, None]
    moved = np.max(np.abs(changes @ joint.shift.T), axis=0)
    limits = np.array([effect.shifts[name] for name in lab.knowledge.names])
    assert np.all(moved <= limits * (1 + 1e-9))
    np.testing.assert_allclose(moved, limits, rtol=0.1)


def test_an_effect_with_a_tolerance_is_counted_in_the_intervals_instead(lab):
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    terms = {"load_friction": "1 %", "platform_spring": 0}
    tolerances = {"force_constant": {"each": "1 %"}, "terms": terms}
    robot = robot_from(load_run({"name": "n", "robot": palida | {"tolerances": tolerances}}).robot)
    experiment = lab.experiment(lab.measure(1), lab.noise)
    estimate = lab.estimate([experiment], "ml")
    found = {one.kind for one in diagnose(robot, [experiment], lab.knowledge, estimate).undetected}
    assert not {"gain", "load_friction", "platform_spring"} & found
    assert {"force_offset", "joint", "stribeck", "platform_wrench"} <= found


def test_the_spread_is_that_of_sizes_below_the_detectable_one(lab):
    """Random effects of one kind at a time, uniform in size or within the ellipsoid."""
    experiment = lab.experiment(lab.measure(1), lab.noise)
    estimate = lab.estimate([experiment], "ml")
    diagnosis = diagnose(lab.robot, [experiment], lab.knowledge, estimate)
    (recording,) = diagnosis.recordings
    spread = undetected_std(diagnosis.undetected)
    rng, largest = np.random.default_rng(2), np.zeros(len(spread))
    for candidate in join_recordings([recording.reliability]):
        sizes, axes = np.linalg.eigh(candidate.fit.covariance * candidate.noncentrality)
        seen = sizes > 1e-9 * sizes[-1]
        assert np.count_nonzero(seen) == candidate.fit.rank
        root = axes[:, seen] * np.sqrt(sizes[seen])
        directions = rng.standard_normal((20000, candidate.fit.rank))
        inside = directions * (
            rng.uniform(size=(20000, 1)) ** (1 / candidate.fit.rank)
            / np.linalg.norm(directions, axis=1)[:, None]
        )
        moved = inside @ (candidate.shift @ root).T
        largest = np.maximum(largest, np.std(moved, axis=0))
    np.testing.assert_allclose(list(spread.values()), largest, rtol=0.05)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (("mass",), "; undetected effects change mass by less than its σ (at most 0.2 kg)"),
        (
            ("mass", "centre", "mass"),
            ", but one would not be seen and could change centre by 3 mm (3 σ); undetected effects "
            "change mass by less than its σ (at most 0.2 kg)",
        ),
        (
            ("centre", "p1"),
            ", but one would not be seen and could change centre by 3 mm (3 σ), other effects p1 "
            "by 0.2 kg m^2 (2 σ)",
        ),
        (
            ("p10", "mass"),
            "; undetected effects change p10 and mass by less than their σ (at most 0.2 kg and "
            "0.2 kg)",
        ),
        (("inertia",), ""),
    ],
)
def test_changes_of_wanted_quantities_in_words(wanted, words):
    sizes = ((0.1, 0.003), (0.2, 0.001))
    effects = [
        UndetectedEffect(
            kind=kind,
            strut=None,
            parameter="",
            constant=None,
            freedom=1,
            size=1.0,
            text=kind,
            shifts={"p10": mass, "p1": mass},
            derived={"mass": mass, "centre_z": centre},
            sigmas=1.0,
            worst="p10",
            forces=1.0,
        )
        for kind, (mass, centre) in zip(("one", "other"), sizes, strict=True)
    ]
    stds = {"p10": 0.25, "p1": 0.1, "mass": 0.25, "centre_z": 0.001}
    units = {"p10": "kg", "p1": "kg m^2", "mass": "kg", "centre_z": "m"}
    assert changes_in_words(effects, stds, units, wanted) == words


def test_held_out_data_have_none(lab):
    experiment = lab.experiment(lab.measure(1), lab.noise)
    other = lab.experiment(lab.measure(2), lab.noise)
    estimate = lab.estimate([experiment], "ml")
    assert not diagnose(lab.robot, [other], lab.knowledge, estimate, held_out=True).undetected


def test_an_effect_in_all_recordings_is_tested_in_all_of_them_together():
    """What one says of the parameters contains the effect, too: alone it misses the other's."""
    lab = Laboratory(samples=60, periods=4)
    both = [lab.measure(seed) for seed in (1, 2)]

    def diagnosed(size):
        disturbed = [replace(data, forces=data.forces + size) for data in both]
        experiments = [lab.experiment(data, lab.noise) for data in disturbed]
        found = diagnose(lab.robot, experiments, lab.knowledge, lab.estimate(experiments, "ml"))
        joint = join_recordings([each.reliability for each in found.recordings])
        return found, next(one for one in joint if one.key[:3] == ("force_offset", "", None))

    sound, before = diagnosed(0.0)
    (effect,) = (one for one in sound.undetected if (one.kind, one.strut) == ("force_offset", None))
    assert sound.verdict.status is Status.ACCEPTED
    _, after = diagnosed(effect.size)
    moved = after.fit.values[0] - before.fit.values[0]
    assert moved == pytest.approx(effect.size, rel=0.02)
    sigmas = effect.size**2 / after.fit.covariance[0, 0]
    assert sigmas == pytest.approx(after.noncentrality, rel=0.02)
    finding = diagnosed(1.5 * effect.size)[0].verdict.failed[0]
    assert finding.contradiction.startswith("all recordings together: the model lacks")
    assert "a constant force" in finding.sentence
