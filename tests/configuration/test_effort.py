"""The effort of a search: starts and hops that are not stated."""

from typing import get_args

import pytest
import yaml

from expdesign.cli.run_commands import EffortOption
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.design import EFFORTS


def run(**changes):
    return load_run({"name": "x", "robot": "palida", **changes})


def size(configuration):
    design = configuration.run.design
    return design.effort, design.starts, design.hops


def test_starts_and_hops_follow_the_effort_and_stated_ones_have_precedence():
    assert size(run()) == ("normal", 24, 80)
    assert size(run(design={"effort": "quick"})) == ("quick", 8, 0)
    assert size(run(design={"effort": "thorough"})) == ("thorough", 384, 800)
    assert size(run(design={"effort": "thorough", "starts": 5})) == ("thorough", 5, 800)
    assert size(run(design={"hops": 7})) == ("normal", 24, 7)


def test_only_the_hops_of_the_normal_effort_end_by_their_expected_gain():
    """Also of the resolved run file, which states them."""
    for design, weighs in (({}, True), ({"hops": 100}, False), ({"effort": "thorough"}, False)):
        first = run(design=design)
        again = load_run(yaml.safe_load(resolved_yaml(first)))
        assert first.run.design.weighs_gain == again.run.design.weighs_gain == weighs


def test_an_effort_of_the_command_line_replaces_stated_starts_and_hops():
    given = run(design={"starts": 5, "hops": 6, "seed": 1}, experiment={})
    assert size(given.with_search("quick")) == ("quick", 8, 0)
    assert size(given.with_search(seed=3)) == ("normal", 5, 6)
    assert given.with_search(seed=3).run.design.seed == 3
    assert given.with_search() is given
    assert given.with_search("quick").run.stages == given.run.stages


@pytest.mark.parametrize(
    ("effort", "seed", "key", "allowed"),
    [
        ("fast", None, "design.effort", EFFORTS),
        (("quick",), None, "design.effort", EFFORTS),
        (None, -1, "design.seed", ("0",)),
        (None, 2**63, "design.seed", (f"{2**63 - 1:,}".replace(",", ""),)),
    ],
)
def test_what_is_not_allowed_is_refused_in_the_words_of_the_run_file(effort, seed, key, allowed):
    with pytest.raises(InputError) as found:
        run().with_search(effort, seed)
    (problem,) = found.value.problems
    assert problem.key == key
    assert all(value in problem.allowed for value in allowed)


def test_the_command_takes_the_efforts_of_the_run_file():
    assert get_args(get_args(get_args(EffortOption)[0])[0]) == tuple(EFFORTS)


def test_it_names_no_stage():
    assert run(experiment={}).with_search("quick", 1).run.stages == ("experiment",)


def test_a_sweep_over_efforts_has_their_starts_and_hops_also_from_its_resolved_run_file():
    swept = run(sweep={"design.effort": ["quick", "thorough"]})
    again = load_run(yaml.safe_load(resolved_yaml(swept)))
    for made in (swept, again, swept.with_search("normal")):
        sizes = [size(point.configuration) for point in made.grid]
        assert sizes == [("quick", 8, 0), ("thorough", 384, 800)]
    seeds = run(sweep={"design.starts": [1, 2]}).with_search("quick", 9).grid
    assert [size(point.configuration) for point in seeds] == [("quick", 1, 0), ("quick", 2, 0)]
    assert [point.configuration.run.design.seed for point in seeds] == [9, 9]
