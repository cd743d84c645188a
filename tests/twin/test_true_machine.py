"""The twin's machine is another robot than the one that is identified."""

import json

import numpy as np
import pytest

from estimation.montecarlo.study import Workbench, study_inputs
from estimation.twin import Truth, Twin
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.robot import Robot, load_robot
from tests.twin.examples import TINY, motion

ROBOT = load_robot("palida")
EXPERIMENT = {"periods": 2, "sampling": 100}
OFFSETS = {f"o{j}": 0.3 * j for j in range(1, 7)}


def machine(**changes):
    """Return PaLiDA as a mapping with keys changed; `parameters` are added to."""
    robot = load_run("palida").run.robot.model_dump(exclude_none=True)
    parameters = robot["parameters"] | changes.pop("parameters", {})
    return robot | {"name": "other", **changes, "parameters": parameters}


def moved(size=1e-3):
    """Return PaLiDA with its platform joints elsewhere, a term more and another mass."""
    joints = ROBOT.description.platform_joints + size * np.arange(18).reshape(6, 3) / 18
    return machine(
        platform_joints=joints.tolist(),
        terms=[*(term.name for term in ROBOT.terms), "force_offset"],
        parameters=OFFSETS | {"p10": 17.0},
    )


ZEROS = np.array([1e-4, 0.0, 0.0, -2e-4, 0.0, 0.0])


def run(truth, noise=TINY, follows="lengths", **more):
    std = {"force_std": [noise] * 6, "length_std": [min(noise, 1e-5)] * 6}
    given = {"name": "n", "robot": "palida", "noise": std, **more}
    return load_run(given | {"experiment": EXPERIMENT | {"truth": truth, "follows": follows}})


def test_lengths_and_forces_are_those_of_the_true_machine():
    configuration = run(moved(), follows="platform")
    twin = Twin.of(configuration, motion())
    true = Robot(configuration.truth)
    states = motion().sample(twin.grid.times)
    np.testing.assert_allclose(twin.lengths, true.inverse_kinematics(states.pose), atol=1e-13)
    np.testing.assert_allclose(twin.forces, true.actuator_forces(*states), atol=1e-10)
    assert np.abs(twin.lengths - ROBOT.inverse_kinematics(states.pose)).max() > 2e-4
    # The estimator keeps the run's robot.
    assert configuration.robot.parameters["p10"] == ROBOT.description.parameters["p10"]
    assert "o1" not in configuration.robot.parameters


def test_a_controller_follows_the_lengths_of_the_drawing():
    """Poses by forward kinematics of the true machine, their derivatives by differences of time."""
    configuration = run(moved())
    configuration = configuration.with_section("experiment", strut_length=tuple(ZEROS))
    twin, true = Twin.of(configuration, motion()), Robot(configuration.truth)
    times = twin.grid.times
    np.testing.assert_allclose(
        twin.lengths, ROBOT.inverse_kinematics(motion().sample(times).pose), atol=1e-13
    )

    def poses(at):
        return true.forward_kinematics(ROBOT.inverse_kinematics(motion().sample(at).pose) - ZEROS)

    step = 1e-3
    ahead, here, behind = (poses(times + shift) for shift in (step, 0.0, -step))
    rate, acceleration = (ahead - behind) / (2 * step), (ahead - 2 * here + behind) / step**2
    smooth = np.min(np.abs(ROBOT.strut_motion(*motion().sample(times)).length_rate), axis=1) > 0.01
    expected = true.actuator_forces(here, rate, acceleration)
    np.testing.assert_allclose(twin.forces[smooth], expected[smooth], atol=2e-3)
    platform = Twin.of(run(moved(), follows="platform"), motion())
    assert np.abs(twin.forces - platform.forces).max() > 0.1


def test_a_term_more_moves_the_forces_by_it_alone():
    names = [*(term.name for term in ROBOT.terms), "force_offset"]
    with_term = Twin.of(run(machine(terms=names, parameters=OFFSETS)), motion())
    plain = Twin.of(run(None), motion())
    np.testing.assert_allclose(
        with_term.forces - plain.forces, np.tile(list(OFFSETS.values()), (400, 1)), atol=1e-10
    )
    np.testing.assert_array_equal(with_term.lengths, plain.lengths)


def test_the_same_machine_measures_the_same():
    one, other = (Twin.of(run(t, noise=1.0), motion()).measurement(3) for t in ("palida", None))
    np.testing.assert_array_equal(one.lengths, other.lengths)
    np.testing.assert_array_equal(one.forces, other.forces)


def test_the_truth_tells_the_machine_and_is_read_again(tmp_path):
    truth = Twin.of(run(moved()), motion()).truth
    truth.write(tmp_path)
    again = Truth.read(tmp_path)
    again.write_as(tmp_path / "again.json")
    first, second = (json.loads((tmp_path / f).read_text()) for f in (truth.FILE, "again.json"))
    assert first == second
    assert (again.robot, again.machine.name) == ("palida", "other")
    assert again.machine.terms[-1] == "force_offset"
    np.testing.assert_array_equal(again.machine.platform_joints, moved()["platform_joints"])
    names = ("o2", "p10", "k1")
    np.testing.assert_array_equal(again.values_of(names), [0.6, 17.0, 0.0])
    assert Twin.of(run(None), motion()).truth.machine is None


def test_constants_of_terms_are_told():
    terms = [*(term.name for term in ROBOT.terms), {"stribeck": {"velocity": 0.05}}]
    found = run(machine(terms=terms, parameters={"s1": 3.0}))
    truth = Twin.of(found, motion()).truth
    assert truth.machine.terms[-1] == {"stribeck": {"velocity": 0.05}}
    assert truth.parameters["s1"] == 3.0
    assert found.truth.constants == (0.05,)


def test_estimates_are_compared_with_the_true_values():
    """An estimator's parameter that the machine has no term for is truly zero."""
    names = [term.name for term in ROBOT.terms]
    estimator = machine(terms=[*names, "force_offset"], parameters=dict.fromkeys(OFFSETS, 0.0))
    heavy = machine(parameters={"p10": 17.0})
    more = {"robot": estimator, "estimate": {"estimators": ["gm"]}}
    configuration = run(heavy, 1.0, **more, montecarlo={"estimators": ["gm"]})
    bench = Workbench.of(configuration, motion())
    outcome = bench.repeat(1).outcomes["gm"]
    truth = bench.twin.truth.values_of(bench.robot.parameter_names)
    assert truth[bench.robot.parameter_names.index("p10")] == 17.0
    assert np.all(truth[-6:] == 0)
    assert outcome.error == ""
    # Seven standard deviations of the worst of thirty: right parameters, not right statistics.
    assert np.all(np.abs(outcome.values - truth) < 7 * outcome.std)
    assert np.all(np.isfinite(bench.bound()))


def test_a_path_is_relative_to_the_run_file(tmp_path):
    (tmp_path / "robots").mkdir()
    found = resolved_yaml(load_run({"name": "n", "robot": moved()}))
    lines = found.splitlines()
    first = lines.index("robot:") + 1
    count = next(k for k, line in enumerate(lines[first:]) if not line.startswith("  "))
    text = "\n".join(line[2:] for line in lines[first : first + count])
    (tmp_path / "robots/other.yaml").write_text(text, encoding="utf-8")
    file = tmp_path / "run.yaml"
    file.write_text(
        "name: n\nrobot: palida\nexperiment: {truth: robots/other.yaml}\n", encoding="utf-8"
    )
    configuration = load_run(file)
    assert configuration.truth.name == "other"
    assert configuration.truth.source == tmp_path / "robots/other.yaml"
    # The resolved run needs the file no more.
    (tmp_path / "resolved.yaml").write_text(resolved_yaml(configuration), encoding="utf-8")
    (tmp_path / "robots/other.yaml").unlink()
    again = load_run(tmp_path / "resolved.yaml")
    assert again.run == configuration.run
    assert again.truth.description == configuration.truth.description


def test_noise_is_the_machines_then_the_robots_and_the_runs_over_both():
    std = {"force_std": [1.0] * 6, "length_std": [1e-5] * 6}
    noisy = machine(noise={"force_std": [2.0] * 6})
    for truth, given, force, length in (
        (machine(noise=None), {}, ROBOT.description.noise.force_covariance[0, 0], 1e-8),
        (noisy, {}, 4.0, 1e-8),
        (noisy, {"noise": std}, 1.0, 1e-10),
    ):
        found = load_run({"name": "n", "robot": "palida", "experiment": {"truth": truth}, **given})
        told = Twin.of(found, motion()).truth
        assert told.force_covariance[0, 0] == pytest.approx(force)
        assert told.length_covariance[0, 0] == pytest.approx(length)


def test_limits_are_those_of_the_robot():
    """The machine's home may lie beyond limits that its file states: they are not used."""
    narrow = machine(limits={"strut_length": [0.1, 0.2]})
    assert len(Twin.of(run(narrow), motion()).forces) == 400


@pytest.mark.parametrize(
    ("truth", "key"),
    [
        ("palidaa", "experiment.truth"),
        ("elsewhere/other.yaml", "experiment.truth"),
        (7, "experiment.truth"),
        ({"name": "other"}, "experiment.truth.home"),
        (machine(base_joints=[[0, 0, 0]] * 6), "experiment.truth"),
    ],
)
def test_what_is_no_machine_is_told_with_its_place(truth, key):
    with pytest.raises(InputError) as caught:
        run(truth)
    assert caught.value.problems[0].key.startswith(key)


def test_what_was_made_before_is_done_still():
    """Keys with their defaults do not show in what earlier results are compared by."""
    plain, named = ({"name": "n", "robot": "palida", "experiment": e} for e in ({}, {"delay": 0}))
    assert study_inputs(load_run(plain), motion()) == study_inputs(load_run(named), motion())
    late = load_run(plain | {"experiment": {"delay": 1e-3}})
    assert study_inputs(load_run(plain), motion()) != study_inputs(late, motion())
