"""What a run may ask for is bounded: told with what it would take, before anything is computed."""

import re

import pytest

from expdesign.cli.run_commands import _MOST_REPETITIONS
from expdesign.configuration import InputError, load_run
from expdesign.configuration.sizes import MEMORY, REPETITIONS, SAMPLES, design_samples

ROBOT = {"name": "large", "robot": "palida"}


def refused(**sections):
    with pytest.raises(InputError) as caught:
        load_run(ROBOT | sections)
    return {problem.key: problem for problem in caught.value.problems}


@pytest.mark.parametrize(
    ("key", "sections"),
    [
        ("trajectory.controller_period", {"trajectory": {"controller_period": 1e-9}}),
        ("trajectory.controller_period", {"trajectory": {"controller_period": 1e-320}}),
        ("experiment.sampling", {"experiment": {"sampling": "1000 MHz"}}),
        ("experiment.sampling", {"experiment": {"sampling": 1e308}}),
        ("experiment.periods", {"experiment": {"periods": 100_000}}),
        ("trajectory.samples", {"trajectory": {"samples": 100_000}}),
        ("trajectory.samples", {"trajectory": {"samples": 5000, "harmonics": 100}}),
        ("trajectory.frequency", {"trajectory": {"frequency": [1e-9, 0.6], "harmonics": 101}}),
        ("montecarlo.repetitions", {"montecarlo": {"repetitions": 10_000_000}}),
        ("export[1].segment", {"export": [{"format": "csv", "segment": "1 us"}]}),
        ("export[1].format", {"export": [{"format": "csv", "scale": 1e-9}]}),
        ("design.starts", {"design": {"starts": 100_000}}),
        ("design.hops", {"design": {"hops": 100_000}}),
        ("design.max_iterations", {"design": {"max_iterations": 100_000}}),
        ("design.smoothing", {"design": {"smoothing": [1 / k for k in range(1, 500)]}}),
        ("estimate.harmonics", {"estimate": {"harmonics": 10_000}}),
        ("workers", {"workers": 1024}),
        ("validate", {"validate": [{"motion": "circle"}] * 1000}),
        (
            "experiment.hum.harmonics",
            {"experiment": {"hum": {"amplitude": 1, "harmonics": [1] * 999}}},
        ),
    ],
)
def test_too_large(key, sections):
    found = refused(**sections)
    if key == "trajectory.frequency":
        # Of an impossible file the first reason is enough; it is refused at once.
        assert found
        return
    assert key in found
    assert found[key].allowed


@pytest.mark.parametrize(
    ("section", "key", "others", "most"),
    [
        ("trajectory", "samples", {}, design_samples(5).most),
        ("trajectory", "samples", {"harmonics": 100}, design_samples(100).most),
        ("montecarlo", "repetitions", {}, REPETITIONS.most),
        ("experiment", "periods", {"sampling": 5000}, SAMPLES.most // 10_000),
        # 1666.67 samples each: the quotient is rounded.
        ("experiment", "periods", {"sampling": 5000 / 6}, SAMPLES.most * 6 // 10_000),
    ],
)
def test_however_large_a_number_is_the_bound_that_holds_is_told(section, key, others, most):
    def run(value):
        sections = {"trajectory": {"frequency": [0.5, 0.5]}}
        sections.setdefault(section, {}).update({**others, key: value})
        return sections

    path, shown = f"{section}.{key}", f"{most:,}".replace(",", " ")
    for value in (most + 1, 50 * most, 10**15):
        assert shown in refused(**run(value))[path].allowed
    for value in (-1, 0):
        numbers = re.findall(r"\d+", refused(**run(value))[path].allowed)
        assert max(map(int, numbers)) < most
    assert load_run(ROBOT | run(most))


def test_a_number_that_no_computer_counts_is_refused():
    for value in (10**30, 10**5000):
        assert "montecarlo.repetitions" in refused(montecarlo={"repetitions": value})


@pytest.mark.parametrize("samples", [-1, 0, 5, 21])
def test_the_fewest_samples_are_told_of_these_harmonics(samples):
    assert "22" in refused(trajectory={"samples": samples})["trajectory.samples"].allowed


def test_what_it_would_take_is_told():
    problem = refused(trajectory={"controller_period": 1e-9})["trajectory.controller_period"]
    assert "40 TB of memory" in problem.message
    assert any(digit in problem.allowed for digit in "123456789")


def test_the_bounds_themselves_are_kept():
    most = SAMPLES.most
    fits = {"frequency": [0.5, 0.5], "controller_period": "1 ms"}
    run = {"trajectory": fits, "experiment": {"periods": most // 2000, "sampling": 1000}}
    assert load_run(ROBOT | run)
    run["experiment"]["periods"] += 1
    assert set(refused(**run)) == {"experiment.periods"}


@pytest.mark.parametrize("harmonics", [1, 5, 100])
def test_every_number_of_harmonics_has_room_for_the_samples_that_it_needs(harmonics):
    size = design_samples(harmonics)
    assert size.most > 4 * harmonics + 2
    assert size.most * size.each <= MEMORY


def test_the_command_line_takes_as_many_repetitions_as_the_run_file():
    assert REPETITIONS.most == _MOST_REPETITIONS
