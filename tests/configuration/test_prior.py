"""A run whose machine was identified before: what it takes, and what it refuses."""

import dataclasses

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.robot import as_general, load_robot_description
from expdesign.configuration.run import robot_yaml
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT, Identification

GENERAL = as_general(load_robot_description("palida").description)
NAMES = tuple(GENERAL.parameters)
BODY = {"mass": "5 kg", "centre": ["20 mm", 0, 0]}


def _identified(robot=GENERAL, *, fixed=(), **changes):
    """A machine as an estimate would have found it."""
    names = tuple(robot.parameters)
    variance = np.array([0.0 if name in fixed else 1e-4 for name in names])
    known = Identification(
        run="first",
        estimator="gm",
        verdict="accepted",
        parameters=names,
        covariance_random=np.diag(variance).tolist(),
        covariance_systematic=np.zeros((len(names),) * 2).tolist(),
    )
    return robot.model_copy(
        update={"name": f"{robot.name}-identified", "identification": known, **changes}
    )


@pytest.fixture
def folder(tmp_path):
    (tmp_path / IDENTIFIED_ROBOT).write_text(robot_yaml(_identified()), encoding="utf-8")
    return tmp_path


def _run(prior, *, robot=GENERAL, section="estimate", **more):
    own = {"prior": prior} | ({"parameters": "payload"} if section == "design" else {}) | more
    return {"name": "loaded", "robot": robot.model_dump(), section: own}


@pytest.mark.parametrize("section", ["design", "estimate"])
@pytest.mark.parametrize("name", ["", IDENTIFIED_ROBOT])
def test_a_run_folder_or_its_robot_is_a_prior(section, name, folder):
    run = load_run(_run(str(folder / name), section=section))
    machine = getattr(run.run, section).prior
    assert machine.name == "palida-identified"
    assert machine.parameters == GENERAL.parameters
    # The whole run stands in its file, with the machine, wherever the folder is by then.
    (folder / IDENTIFIED_ROBOT).unlink()
    path = folder / "resolved.yaml"
    path.write_text(resolved_yaml(run), encoding="utf-8")
    assert load_run(path).run == run.run


def test_a_path_is_relative_to_the_run_file(folder):
    (folder / "robot.yaml").write_text(robot_yaml(GENERAL), encoding="utf-8")
    text = "name: near\nrobot: robot.yaml\nestimate: {prior: identified-robot.yaml}\n"
    (folder / "run.yaml").write_text(text, encoding="utf-8")
    assert load_run(folder / "run.yaml").run.estimate.prior.name == "palida-identified"


def test_payload_stands_for_the_ten_of_the_platform(folder):
    design = load_run(_run(str(folder), section="design")).run.design
    assert set(design.parameters) == set(NAMES[5:15])


def _moved(joints):
    return tuple((x + 1e-4, y, z) for x, y, z in joints)


@pytest.mark.parametrize(
    ("machine", "wrong"),
    [
        (_identified().model_copy(update={"name": "other-identified"}), "the machine other"),
        (_identified(load_robot_description("palida").description), "symmetric"),
        (_identified(identification=None), "not identified"),
        (_identified(base_joints=_moved(GENERAL.base_joints)), "base_joints"),
        (_identified(gravity=(0.0, 0.0, -9.8)), "gravity"),
        (_identified(fixed=("sx", "p7")), "p7, sx"),
    ],
)
def test_another_machine_is_refused(machine, wrong, tmp_path):
    path = tmp_path / IDENTIFIED_ROBOT
    path.write_text(robot_yaml(machine), encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_run(_run(str(tmp_path)))
    (problem,) = error.value.problems
    assert problem.key == "estimate.prior"
    assert wrong in problem.message
    assert problem.allowed


def test_other_terms_are_refused(folder):
    offset = {**GENERAL.model_dump(), "terms": [*(t.name for t in GENERAL.terms), "force_offset"]}
    with pytest.raises(InputError) as error:
        load_run({"name": "more", "robot": offset, "estimate": {"prior": str(folder)}})
    (problem,) = error.value.problems
    assert problem.key == "estimate.prior"
    assert "force_offset" in problem.allowed


@pytest.mark.parametrize("change", [-2.0, 3e-4])
def test_what_is_no_covariance_is_refused(change, tmp_path):
    machine = _identified()
    rows = np.array(machine.identification.covariance_random)
    rows[0, 1] = rows[1, 0] = change
    covariance = tuple(map(tuple, rows.tolist()))
    known = machine.identification.model_copy(update={"covariance_random": covariance})
    path = tmp_path / IDENTIFIED_ROBOT
    text = robot_yaml(machine.model_copy(update={"identification": known}))
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="eigenvalues"):
        load_run(_run(str(path)))


@pytest.mark.parametrize("section", ["design", "estimate"])
def test_a_folder_without_an_estimate_is_refused_at_its_key(section, tmp_path):
    for place in (tmp_path, tmp_path / "nowhere", "nothing-ships-by-this-name"):
        with pytest.raises(InputError) as error:
            load_run(_run(str(place), section=section))
        (problem,) = error.value.problems
        assert problem.key == f"{section}.prior"
        assert IDENTIFIED_ROBOT in problem.allowed


def test_a_symmetric_platform_carries_no_payload(tmp_path):
    symmetric = load_robot_description("palida").description
    path = tmp_path / IDENTIFIED_ROBOT
    path.write_text(robot_yaml(_identified(symmetric)), encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_run(_run(str(path), robot=symmetric))
    assert [problem.key for problem in error.value.problems] == ["estimate.prior"]
    with pytest.raises(InputError) as error:
        load_run({"name": "one", "robot": "palida", "experiment": {"payload": BODY}})
    assert [problem.key for problem in error.value.problems] == ["experiment.payload"]
    with pytest.raises(InputError) as error:
        load_run({"name": "one", "robot": "palida", "design": {"parameters": "payload"}})
    assert {problem.key for problem in error.value.problems} == {"design.parameters"}


@pytest.mark.parametrize(
    ("section", "more", "key"),
    [
        ("estimate", {"fixed": ["p1"]}, "estimate.fixed"),
        ("estimate", {"prior_from": "robot"}, "estimate.prior_from"),
        ("estimate", {"parameters": "base"}, "estimate.parameters"),
        ("design", {"interest": ["p10"]}, "design.interest"),
    ],
)
def test_what_does_not_go_with_a_prior(section, more, key, folder):
    with pytest.raises(InputError) as error:
        load_run(_run(str(folder), section=section, **more))
    assert [problem.key for problem in error.value.problems] == [key]


def test_the_robots_own_identification_is_no_prior_of_a_payload():
    run = {"name": "n", "robot": GENERAL.model_dump(), "experiment": {"payload": BODY}}
    with pytest.raises(InputError) as error:
        load_run(run | {"estimate": {"prior_from": "robot"}})
    assert [problem.key for problem in error.value.problems] == ["estimate.prior_from"]


def test_a_payload_is_on_the_robot_and_on_the_machine_that_is_measured():
    run = load_run(
        {
            "name": "carries",
            "robot": GENERAL.model_dump(),
            "experiment": {"payload": BODY, "truth": "palida"},
        }
    )
    for robot in (run.robot, run.truth):
        assert robot.platform == "general"
        assert robot.parameters["p10"] == pytest.approx(GENERAL.parameters["p10"] + 5)
        assert robot.parameters["sx"] == pytest.approx(0.1)
        # Not in the description: a resolved run that is loaded again carries it once.
        assert robot.description.parameters["p10"] == GENERAL.parameters["p10"]
    again = load_run(dataclasses.replace(run).run)
    assert again.robot.parameters == run.robot.parameters
    assert again.truth.parameters == run.truth.parameters
    assert again.run == run.run
