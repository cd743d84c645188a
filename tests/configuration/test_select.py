from importlib.resources import files

import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.run import add_terms

IDENTIFIED = files("expdesign.library") / "identified" / "palida.yaml"
BODY = {"mass": "5 kg", "centre": [0, 0, "50 mm"], "inertia": [0.02, 0.03, 0.025]}


def selecting(candidates, **others):
    return {"select": {"candidates": candidates, **others}}


def test_what_is_printed_loads_again(tmp_path, run_mapping):
    candidates = [{"stribeck": {"velocity": "50 mm/s"}}, "drive_inertia"]
    run = load_run(run_mapping | {"estimate": selecting(candidates, by="f", level=0.05)})
    (tmp_path / "run.yaml").write_text(resolved_yaml(run), encoding="utf-8")
    again = load_run(tmp_path / "run.yaml").run.estimate.select
    assert again == run.run.estimate.select
    assert again.candidates[0].constants["velocity"].value == 0.05
    assert (again.by, again.level) == ("f", 0.05)


@pytest.mark.parametrize(
    ("estimate", "key", "nearest"),
    [
        (selecting(["actuator_friction"]), "estimate.select.candidates[1]", None),
        (selecting(["force_offset", "stribek"]), "estimate.select.candidates", "stribeck"),
        (selecting([]), "estimate.select.candidates", None),
        (selecting(["force_offset", "force_offset"]), "estimate.select.candidates", None),
        (selecting(["stribeck"]), "estimate.select.candidates.stribeck.velocity", None),
        (selecting(["cogging_second"]), "estimate.select.candidates[1]", None),
        (selecting(["force_offset"], by="bik"), "estimate.select.by", "bic"),
        (selecting(["force_offset"], level=0.01), "estimate.select.level", None),
        (selecting(["force_offset"], by="f", level=1), "estimate.select.level", None),
        (selecting(["force_offset"]) | {"bounds": {"m_drive": [0, 1]}}, "estimate.bounds", None),
        (selecting(["force_offset"]) | {"fixed": {"o1": 1}}, "estimate.fixed", "v1"),
        (selecting(["force_offset"]) | {"prior_from": "robot"}, "estimate.prior_from", None),
        (selecting(["force_offset"]) | {"prior": "IDENTIFIED"}, "estimate.prior", None),
    ],
)
def test_what_cannot_be_selected(run_mapping, problems_of, estimate, key, nearest):
    if estimate.get("prior") == "IDENTIFIED":
        estimate = estimate | {"prior": str(IDENTIFIED)}
        run_mapping = run_mapping | {"robot": str(IDENTIFIED)}
    problem = problems_of(run_mapping | {"estimate": estimate})[0]
    assert problem.key == key
    assert problem.nearest == nearest


def test_a_companion_may_be_the_robots(run_mapping):
    run_mapping["robot"]["terms"].append({"cogging": {"pitch": 0.03}})
    run_mapping["robot"]["parameters"] |= {f"c{k}{j}": 0 for k in "sc" for j in range(1, 7)}
    run = load_run(run_mapping | {"estimate": selecting(["cogging_second"])})
    wide = add_terms(run, run.run.estimate.select.candidates).robot
    assert wide.constants == (0.03,)
    assert wide.parameter_names[-1] == "dc6"


def test_stages_that_do_not_select_say_so(run_mapping):
    found = selecting(["force_offset"])
    quiet = load_run(run_mapping | {"estimate": found}).warnings
    told = load_run(run_mapping | {"estimate": found, "montecarlo": {}}).warnings
    (only,) = set(told) - set(quiet)
    assert "montecarlo" in only


def test_added_terms_are_those_of_a_robot_file(run_mapping):
    given = ["load_friction", {"cable": {"rest_length": 0.6}}, {"stribeck": {"velocity": 0.05}}]
    run = load_run(run_mapping | {"estimate": selecting(given)})
    wide = add_terms(run, run.run.estimate.select.candidates).robot
    known = run_mapping["robot"]
    # The load of the actuators counts the cables, whatever friction is listed where.
    own = known["terms"]
    terms = [*own[:2], given[1], *own[2:], given[0], given[2]]
    assert [term.name for term in run.robot.terms if term.rates] == own[2:]
    again = load_run({"name": "again", "robot": known | {"terms": terms}}).robot
    assert wide.terms == again.terms
    assert wide.constants == again.constants
    assert dict(wide.parameters) == dict(again.parameters)
    assert list(wide.parameters) == list(again.parameters)
    assert add_terms(load_run({"name": "a", "robot": known | {"terms": terms}}), ()).robot


def test_a_payload_stays_on_the_machine():
    sections = {"experiment": {"payload": BODY}, "estimate": selecting(["force_offset"])}
    run = load_run({"name": "n", "robot": str(IDENTIFIED)} | sections)
    wide = add_terms(run, run.run.estimate.select.candidates)
    assert wide.robot.parameters["p10"] == run.robot.parameters["p10"]
    assert run.robot.parameters["p10"] - run.robot.description.parameters["p10"] == pytest.approx(5)
    # What stands in the file has none of it, and resolving it again adds it once.
    assert wide.run.robot.parameters["p10"] == run.robot.description.parameters["p10"]


def test_what_bears_comes_before_the_load_is_taken(run_mapping):
    robot = run_mapping["robot"]
    robot["terms"].append("load_friction")
    robot["parameters"] |= {f"mu{j}": 0.01 for j in range(1, 7)}
    balance = {"base_x": 0, "base_y": 0, "base_z": 1, "length": 1}
    run = load_run(run_mapping | {"estimate": selecting([{"gravity_compensation": balance}])})
    wide = add_terms(run, run.run.estimate.select.candidates).robot
    names = [term.name for term in wide.terms]
    assert names.index("gravity_compensation") < names.index("load_friction")
