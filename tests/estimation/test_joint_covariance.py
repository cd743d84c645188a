"""Parameters and constants that are estimated together: their joint covariance, and its uses."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import scipy
from ruamel.yaml import YAML

from estimation.estimators import PerturbedMachine
from estimation.estimators.prior_estimate import PriorEstimate
from estimation.feedforward.comparison import true_machine
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.result import EstimationResult
from estimation.uncertainty.forces import force_uncertainty
from expdesign.configuration import InputError, load_run
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as FILE
from expdesign.information.identifiable import BaseParameters
from expdesign.robot import load_robot, robot_from
from expdesign.robot.deviation import apply_deviations, deviations
from tests.estimation import constants as case
from tests.estimation.cases import read_estimate
from tests.estimation.constants import MOTION

NEAR = case.guess(case.PITCH), case.guess(case.VELOCITY)
TOLERANCES = {"base_joints": "0.1 mm", "force_constant": {"common": "1 %"}}
DRAWS = 4000


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A result, and the folder with its files."""
    result = estimate_parameters(case.run(tolerances=TOLERANCES), case.data(5), MOTION)
    folder = tmp_path_factory.mktemp("joint")
    estimation_result(result).write(folder)
    return result, folder


def test_constants_by_maximum_likelihood_scatter_as_stated_where_noise_remembers(known_channels):
    """By noise that changes its sign from sample to sample, a quarter as much and less."""
    memory, runs, own = -0.95, 8, case.machine().description.noise
    exact, found = case.data(scale=0.0), {}
    spectra = {"white": {}, "coloured": {"force_spectrum": {"ar": memory}}}
    for name, spectrum in spectra.items():
        section = {"estimators": ["ml"], "spectrum": "white"}
        config = case.run(*NEAR, estimate=section, noise=case.noise() | spectrum)
        errors = []
        for seed in range(runs if spectrum else 1):
            rng = np.random.default_rng(seed)
            forces, lengths = (
                case.QUIET * rng.normal(size=(len(exact.time), 6)) @ np.linalg.cholesky(each).T
                for each in (own.force_covariance, own.length_covariance)
            )
            size = np.sqrt(1 - memory**2)
            forces = scipy.signal.lfilter([size], [1, -memory], forces, axis=0)
            noisy = replace(exact, forces=exact.forces + forces, lengths=exact.lengths + lengths)
            one = estimate_parameters(config, noisy, MOTION)["ml"].systematic
            errors.append(one.values)
            found[name] = one.std
        squares = np.sum((errors / found[name]) ** 2, axis=0)
    low, high = scipy.stats.chi2.ppf([2e-4, 1 - 2e-4], runs)
    assert np.all((low < squares) & (squares < high))
    assert np.all(found["coloured"] ** 2 < 0.3 * found["white"] ** 2)


def test_forces_of_a_control_model_are_as_uncertain_as_drawn_ones(written):
    """Monte Carlo of parameters and constants together, moved in the robot itself."""
    robot = load_robot(written[1] / FILE)
    known = robot.description.description.identification
    count, entries = len(known.parameters), {one.name: one for one in deviations(robot)}
    assert known.constants == ("cogging_pitch", "stribeck_velocity")
    found = force_uncertainty(robot, known, MOTION)
    motion = MOTION.sample(found.time[::40])
    random, systematic = map(np.array, (known.covariance_random, known.covariance_systematic))
    rng, chosen = np.random.default_rng(3), [entries[name] for name in known.constants]
    for covariance, stated in ((random, found.std_random), (random + systematic, found.std)):
        std = np.sqrt(np.diag(covariance))
        unit = covariance / np.multiply.outer(std, std)
        drawn = std * rng.multivariate_normal(0 * std, unit, DRAWS, method="eigh")
        forces = []
        for one in drawn[: DRAWS // 4]:
            moved = apply_deviations(robot, chosen, one[count:])
            forces.append(moved.actuator_forces(*motion, robot.parameters + one[:count]))
        spread = np.std(forces, axis=0)
        np.testing.assert_allclose(spread / stated[::40], 1, atol=4.5 / np.sqrt(DRAWS / 2))
    # Without the constants they would look much less sure.
    own = {"constants": (), "deviations": (), "response": ()}
    for key in ("covariance_random", "covariance_systematic"):
        own[key] = tuple(row[:count] for row in getattr(known, key)[:count])
    alone = force_uncertainty(robot, known.model_copy(update=own), MOTION)
    assert np.linalg.norm(alone.std_random) > 1.3 * np.linalg.norm(found.std_random)


def _drawn(folder, seed):
    config = case.run(
        tolerances=TOLERANCES, experiment={"seed": seed}, data={"file": "measured.csv"}
    )
    nominal = robot_from(config.robot)
    saved = read_estimate(folder, nominal)
    systematic = saved.estimate.systematic
    machine = PerturbedMachine.of(nominal, systematic.deviations, systematic.values)
    return saved, machine, true_machine(config, saved, machine, np.zeros(1))


def test_a_machine_is_drawn_with_constants_geometry_and_gains(written):
    """Its forces scatter by the whole of the joint covariance, by difference quotients."""
    motion, off = MOTION.sample(np.linspace(0, MOTION.period, 7)[:-1]), []
    for seed in range(60):
        saved, machine, found = _drawn(written[1], seed)
        gains = found.gains[0] - machine.gains
        one, known = found.model, saved.estimate.values
        moved = one.robot.actuator_forces(*motion, one.values) * (1 + gains)
        off.append(moved - machine.robot.actuator_forces(*motion, known))
    estimated = saved.estimate

    def forces(entry, size):
        theta = estimated.systematic.values + size * np.eye(len(machine.chosen))[entry]
        nominal = robot_from(case.run().robot)
        moved = PerturbedMachine.of(nominal, machine.chosen, theta)
        return moved.robot.actuator_forces(*motion, estimated.values) * moved.gains

    steps = 1e-6 * np.maximum(estimated.systematic.std, 1e-6)
    slopes = [(forces(k, s) - forces(k, -s)) / (2 * s) for k, s in enumerate(steps)]
    regressor = machine.robot.regressor(*motion)
    columns = np.concatenate([regressor, np.moveaxis(slopes, 0, -1)], axis=2)
    joint, own = estimated.joint, estimated.covariance
    size = np.einsum("nij,jk,nik->", columns, joint, columns)
    assert np.sum(np.mean(np.square(off), axis=0)) == pytest.approx(size, rel=0.3)
    # Parameters alone would be wrong by far more than these.
    assert np.einsum("nij,jk,nik->", regressor, own, regressor) > 3 * size


def test_files_with_a_joint_covariance_of_another_size_are_refused(written, tmp_path):
    folder = shutil.copytree(written[1], tmp_path / "wrong")
    path = folder / "estimate.json"
    data = json.loads(path.read_text())
    data["estimators"]["gm"]["covariance_joint"] = [[1.0]]
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="covariance_joint"):
        EstimationResult.read(folder)


def _after(robot, **section):
    given = {"noise": "given", "harmonics": 2, "estimators": ["gm", "ml"], "prior_from": "robot"}
    noise, robot = case.noise(), str(robot)
    return load_run({"name": "after", "robot": robot, "noise": noise, "estimate": given | section})


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """The robot file of one recording, and what two tell at once."""
    run, folder = case.run(estimate={"estimators": ["gm", "ml"]}), tmp_path_factory.mktemp("prior")
    first, second = case.data(1), case.data(2)
    estimation_result(estimate_parameters(run, first, MOTION)).write(folder)
    return folder / FILE, second, estimate_parameters(run, [first, second], MOTION)


def test_one_recording_after_the_other_is_both_at_once(earlier):
    path, second, both = earlier
    found = estimate_parameters(_after(path), second, MOTION)
    abouts = load_robot(path).description, case.run().robot
    began = [np.array(about.constants) for about in abouts]
    for name, one in found.estimates.items():
        whole = both[name]
        values, expected = (
            np.concatenate([e.values, start + e.systematic.values[:2]])
            for e, start in zip((one, whole), began, strict=True)
        )
        std = np.sqrt(np.diag(whole.joint))
        np.testing.assert_allclose((values - expected) / std, 0, atol=0.25)
        off = (one.joint - whole.joint) / np.multiply.outer(std, std)
        assert np.max(np.abs(off)) < 0.2
        # Nothing had a tolerance: what stands as one in the file is no further knowledge.
        assert not np.any(one.covariance_systematic)


@pytest.mark.slow
def test_a_tolerance_of_a_constant_counts_once_in_later_estimates(tmp_path):
    """It is part of what the earlier estimate knows, and neither the whole of it nor nothing."""
    tolerances = {"terms": {"stribeck": {"velocity": "0.2 mm/s"}, "cogging": {"pitch": "1 mm"}}}
    run = case.run(tolerances=tolerances)
    first, second = case.data(1), case.data(2)
    estimation_result(estimate_parameters(run, first, MOTION)).write(tmp_path)
    found = estimate_parameters(_after(tmp_path / FILE, estimators=["gm"]), second, MOTION)["gm"]
    whole = estimate_parameters(run, [first, second], MOTION)["gm"]
    ratio = np.sqrt(np.diag(found.joint) / np.diag(whole.joint))
    np.testing.assert_allclose(ratio, 1, atol=0.1)


def test_what_is_fixed_moves_what_the_prior_says_of_constants(earlier):
    path, second, _ = earlier
    robot = load_robot(path)
    known = np.array(robot.description.description.identification.covariance_random)
    place, value = robot.parameter_names.index("s1"), dict(robot.description.parameters)["s1"]
    shift = 4 * np.sqrt(known[place, place])
    # Little noise of the prior beside that of the recording: it tells alone.
    noisy = {key: (1e8 * np.array(size)).tolist() for key, size in case.noise().items()}
    config = _after(path, fixed={"s1": value + shift}, estimators=["gm"])
    config = load_run(config.run.model_dump(by_alias=True) | {"noise": noisy})
    found = estimate_parameters(config, second, MOTION)["gm"].systematic
    expected = known[-2:, place] / known[place, place] * shift
    own = np.diag(known)[-2:]
    np.testing.assert_allclose((found.values - expected) / np.sqrt(own), 0, atol=0.05)
    left = own - known[-2:, place] ** 2 / known[place, place]
    np.testing.assert_allclose(found.std**2, left, rtol=0.05)


@pytest.mark.parametrize("how", ["taken as known", "an earlier version"])
def test_constants_without_their_covariance_are_no_prior(earlier, tmp_path, how):
    path, second, _ = earlier
    yaml = YAML()
    data = yaml.load(path)
    if how == "taken as known":
        data["terms"][-1]["stribeck"]["velocity"]["estimate"] = False
    else:
        known, count = data["identification"], len(data["identification"]["parameters"])
        del known["constants"]
        for key in ("covariance_random", "covariance_systematic"):
            known[key] = [row[:count] for row in known[key][:count]]
    changed = tmp_path / FILE
    yaml.dump(data, changed)
    with pytest.raises(InputError, match="stribeck_velocity") as caught:
        estimate_parameters(_after(changed), second, MOTION)
    assert caught.value.problems[0].key == "estimate.prior_from"


def test_constants_stay_beside_combinations_of_an_earlier_estimate():
    """By formulas for the normal distribution: conditional on what is fixed, then combined."""
    rng = np.random.default_rng(3)
    root, mean = rng.standard_normal((6, 6)), rng.standard_normal(6)
    covariance, held = root @ root.T, rng.standard_normal(4)
    response = rng.standard_normal((6, 1))
    earlier = PriorEstimate(mean, np.linalg.inv(covariance), (), response)
    base = BaseParameters(
        ("a", "b", "c"), ("a", "c"), np.array([[1.0, 2.0, 0.0], [0.0, -0.5, 1.0]]), np.ones(3)
    )
    found = earlier.of_combinations(base, ("a", "b", "c", "d"), held)

    others, fixed = [0, 1, 2, 4, 5], 3
    pull = covariance[others, fixed] / covariance[fixed, fixed]
    conditional = mean[others] + pull * (held[3] - mean[fixed])
    left = covariance[np.ix_(others, others)] - np.outer(pull, covariance[fixed, others])
    combined = np.array(
        [[1, 2, 0, 0, 0], [0, -0.5, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]], dtype=float
    )
    own = [0, 2, 4, 5]
    start = np.append(held[:3], [0.0, 0.0])
    expected = np.append(held[[0, 2]], [0.0, 0.0]) + combined @ (conditional - start)
    np.testing.assert_allclose(found.values[own], expected)
    np.testing.assert_allclose(
        np.linalg.inv(found.precision[np.ix_(own, own)]), combined @ left @ combined.T
    )
    assert not np.any(found.precision[[1, 3]])
    moved = combined @ (response[others] - pull[:, None] * response[fixed])
    np.testing.assert_allclose(found.response[own], moved)
