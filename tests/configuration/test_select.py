import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.added_terms import with_added_terms


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
        (selecting(["force_offset"]) | {"prior_from": "robot"}, "estimate.prior_from", None),
    ],
)
def test_what_cannot_be_selected(run_mapping, problems_of, estimate, key, nearest):
    problem = problems_of(run_mapping | {"estimate": estimate})[0]
    assert problem.key == key
    assert problem.nearest == nearest


def test_a_companion_may_be_the_robots(run_mapping):
    run_mapping["robot"]["terms"].append({"cogging": {"pitch": 0.03}})
    run_mapping["robot"]["parameters"] |= {f"c{k}{j}": 0 for k in "sc" for j in range(1, 7)}
    run = load_run(run_mapping | {"estimate": selecting(["cogging_second"])})
    wide = with_added_terms(run, run.run.estimate.select.candidates).robot
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
    wide = with_added_terms(run, run.run.estimate.select.candidates).robot
    known = run_mapping["robot"]
    # The load of the actuators counts the cables.
    terms = [*known["terms"], given[1], given[0], given[2]]
    again = load_run({"name": "again", "robot": known | {"terms": terms}}).robot
    assert wide.terms == again.terms
    assert wide.constants == again.constants
    assert dict(wide.parameters) == dict(again.parameters)
    assert list(wide.parameters) == list(again.parameters)
    assert with_added_terms(load_run({"name": "a", "robot": known | {"terms": terms}}), ()).robot
