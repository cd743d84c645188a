"""Measuring times for wanted precisions, against the prediction and against experiments."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from estimation.identification import estimate_parameters
from estimation.identification.estimator_result import estimated_quantities
from expdesign.cli.app import app
from expdesign.configuration import InputError
from expdesign.configuration.run import GridPoint
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.plan import (
    PlanResult,
    Prediction,
    goals_of_design,
    minutes_to_goals,
    plan_measurement,
)
from expdesign.experiment.precision import (
    derived_precisions,
    experiment_information,
    parameter_precisions,
    precision,
    predicted_errors,
    tolerance_std,
)
from expdesign.experiment.result import PredictedStd
from expdesign.experiment.sweep import SweptDesign, sweep_result
from expdesign.robot import robot_from
from expdesign.robot.deviation import apply_deviations, toleranced_deviations
from results.comparison.designs import ComparedDesign
from results.views.design import limit_title
from results.views.folder import RunFolder
from results.views.goals import design_goal_blocks
from results.views.plan import plan_view
from results.views.view import ReportTable, TextBlock, cell_text
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory

MOTION = trajectory()
SETTINGS = {"noise": "given", "harmonics": 2}
TOLERANCES = {"base_joints": "0.1 mm", "force_constant": {"common": "0.5 %"}, "gravity": "0.1 deg"}


def _run(goals, tolerances=None, periods=5, **settings):
    given = {} if tolerances is None else {"tolerances": tolerances}
    return run(
        {**SETTINGS, **settings},
        goals=goals,
        experiment={"periods": periods, "sampling": f"{1 / STEP} Hz"},
        **given,
    )


def test_noise_alone_falls_with_the_root_of_the_periods():
    plan = plan_measurement(_run({"mass": "0.5 %", "centre": "0.05 mm", "v1": 0.5}), MOTION)
    assert plan.reachable
    for goal in plan.goals:
        assert goal.floor == 0
        assert goal.periods == np.ceil(5 * (goal.std / goal.wanted) ** 2)
        assert goal.minutes == pytest.approx(goal.periods * MOTION.period / 60)
        assert goal.source == "noise"
    assert plan.periods == max(goal.periods for goal in plan.goals)
    assert [goal.quantity for goal in plan.goals] == ["mass", "centre_z", "v1"]


@pytest.mark.parametrize("systematic", ["auto", "budget"])
def test_a_goal_below_the_floor_names_the_tolerance(systematic):
    """The common force constant is in the mass like a factor: its tolerance is the floor."""
    tolerances = {**TOLERANCES, "base_joints": "10 um", "gravity": "0.01 deg"}
    plan = plan_measurement(
        _run({"mass": "0.4 %", "v1": "50 %"}, tolerances, systematic=systematic), MOTION
    )
    mass, friction = plan.goals
    assert friction.reachable
    assert not mass.reachable
    assert not plan.reachable
    assert np.isnan(plan.periods)
    assert mass.floor == pytest.approx(0.005 * 16.307, rel=0.25)
    assert mass.obstacle == "force_constant.common"
    smaller = {"common": f"{0.5 * mass.tolerance_percent / 100} %"}
    changed = {**tolerances, "force_constant": smaller}
    reached = plan_measurement(
        _run({"mass": "0.4 %"}, changed, systematic=systematic), MOTION
    ).goals[0]
    assert reached.reachable
    assert reached.floor == pytest.approx(mass.wanted * np.sqrt(0.5), rel=1e-3)


def test_the_largest_source_is_that_of_the_standard_deviation_in_its_row():
    plan = plan_measurement(_run({"mass": "0.1 %"}, {"force_constant": {"common": "1 %"}}), MOTION)
    (goal,) = plan.goals
    assert not goal.reachable
    assert goal.std > 2 * goal.tolerance * 16.307
    assert (goal.source, goal.obstacle) == ("noise", "force_constant.common")


@pytest.mark.parametrize(
    ("goals", "words"),
    [
        ({"mas": "1 %"}, "did you mean 'mass'"),
        ({"mass": "5 mm"}, "5 mm"),
        ({"centre": 0}, "not above zero"),
        ({}, "no goal"),
    ],
)
def test_goals_that_are_refused(goals, words):
    with pytest.raises(InputError) as refused:
        plan_measurement(_run(goals), MOTION)
    assert words in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("systematic", ["auto", "budget"])
def test_experiments_of_the_planned_length_reach_the_goals(systematic):
    """The errors of 40 machines within their tolerances have the wanted size, within 3 σ of it."""
    config = _run({"mass": "0.8 %"}, TOLERANCES, systematic=systematic)
    (goal,) = plan_measurement(config, MOTION).goals
    assert goal.reachable
    nominal = robot_from(config.robot)
    chosen = toleranced_deviations(nominal)
    tolerances = np.array([one.tolerance for one in chosen])
    gain = [one.name for one in chosen].index("force_constant")
    ratios = []
    for seed in range(40):
        theta = tolerances * np.random.default_rng(100 + seed).normal(size=len(chosen))
        machine = apply_deviations(ROBOT, chosen, theta)
        data = measured(MOTION, seed, robot=machine, periods=int(goal.periods))
        data = replace(data, forces=data.forces * (1 + theta[gain]))
        found = estimate_parameters(config, data, MOTION)
        rows = estimated_quantities(found.robot, found.best, None)
        mass = next(row for row in rows if row.quantity == "mass")
        assert mass.std == pytest.approx(goal.wanted, rel=0.1)
        ratios.append((mass.value - 16.307) / goal.wanted)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=3 / np.sqrt(2 * 40))


@pytest.mark.parametrize("systematic", ["auto", "budget"])
def test_a_comparison_states_the_periods_of_the_plan(systematic):
    wanted = dict.fromkeys(("p1", "p6", "r2", "v1"), "5 %")
    configuration = _run(wanted, TOLERANCES, systematic=systematic)
    goals = plan_measurement(configuration, MOTION).goals
    names = ROBOT.parameter_names
    design = SimpleNamespace(
        configuration=configuration,
        trajectory=MOTION,
        parameter_names=names,
        parameters=[SimpleNamespace(nominal=value) for value in ROBOT.parameters],
        systematic=dict.fromkeys(names, 1.0),
    )
    periods = ComparedDesign("a", design).periods(0.05, 1 / STEP)
    found = [periods[names.index(goal.goal)] for goal in goals]
    stated = [goal.periods if goal.reachable else np.inf for goal in goals]
    assert found == stated
    assert len(set(found)) > 2


def test_a_goal_of_years_is_not_reached_for_its_noise():
    plan = plan_measurement(_run({"v1": "0.00001 %"}, {"gravity": "1e-9 deg"}), MOTION)
    (goal,) = plan.goals
    assert not goal.reachable
    assert goal.obstacle == "noise"
    assert goal.floor < goal.wanted
    assert np.isnan(goal.tolerance_percent)


def test_the_floor_rises_with_its_tolerances():
    """Estimated tolerances that the data show well leave less, but never less than smaller ones."""

    def floor(factor):
        tolerances = {"gravity": f"{0.1 * factor} deg", "base_joints": f"{0.1 * factor} mm"}
        (goal,) = plan_measurement(_run({"mass": "1 %"}, tolerances), MOTION).goals
        return goal.floor

    floors = [floor(factor) for factor in (0.01, 0.1, 1, 10, 100)]
    assert floors == sorted(floors)
    assert floors[0] > 0


def test_a_goal_of_a_change_is_refused(tmp_path):
    with pytest.raises(InputError, match="prior"):
        plan_measurement(
            _run({"mass": "1 %"}, design={"prior": "palida", "parameters": "payload"}), MOTION
        )


@pytest.mark.parametrize("want", ["mas=1%", "mass=1 m", "centre=-1 mm"])
def test_a_wish_is_checked_before_a_design_is_searched_for(want, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(app, ["plan", "palida", "--want", want])
    assert isinstance(found.exception, InputError)
    (problem,) = found.exception.problems
    assert problem.file is None
    assert problem.key.startswith("--want")
    assert not list(tmp_path.rglob("design.json"))


def test_goals_are_checked_with_the_run_file(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("{name: n, robot: palida, goals: {mass: 1 parsec}}", encoding="utf-8")
    found = CliRunner().invoke(app, ["check", str(file)])
    assert isinstance(found.exception, InputError)
    assert found.exception.problems[0].key == "goals.mass"


def _shown(plan):
    """The texts of the view, and its facts."""
    view = plan_view(RunFolder(Path(), {}, _run({}), results={PlanResult: plan}))
    texts = [block.text for block in view.blocks if isinstance(block, TextBlock)]
    return view.verdict.sentence, " ".join(texts), view.facts


def test_a_floor_just_above_a_goal_differs_in_the_shown_digits():
    plan = plan_measurement(_run({"mass": "1 %"}), MOTION)
    goal = replace(plan.goals[0], reachable=False, wanted=0.186, floor=0.18614)
    plan = replace(plan, goals=(goal,))
    view = plan_view(RunFolder(Path(), {}, _run({}), results={PlanResult: plan}))
    (table,) = (block for block in view.blocks if isinstance(block, ReportTable))
    cells = dict(zip(table.columns, table.rows[0], strict=True))
    shown = {column.title: cell_text(column, value) for column, value in cells.items()}
    assert (shown["σ wanted"], shown["σ, floor"]) == ("0.186", "0.1861")


def test_remarks_on_what_a_goal_means():
    plan = plan_measurement(_run({"centre": "5 mm"}), MOTION)
    (goal,) = plan.goals
    assert (goal.quantities, goal.periods) == ("centre_z", 1)
    sentence, texts, _ = _shown(plan)
    assert "3 periods or more" in sentence
    assert "centre_z alone" in texts
    assert "sliders' masses" in texts
    sentence, texts, _ = _shown(plan_measurement(_run({"v1": "1 %"}), MOTION))
    assert "or more" not in sentence
    assert "sliders" not in texts
    assert "the tests may miss" in texts  # and that is not counted


@pytest.mark.parametrize(
    ("goals", "sizes", "words"),
    [
        ({"mass": "0.7 %"}, ["0.163", "0.114", "0.231"], "to 0.49 % (1 % is stated)"),
        ({"mass": "1 %"}, ["0.163", "0.163", "0.231"], "to 0.71 % (1 % is stated)"),
        ({"centre": "0.1 nm"}, [], "after 30 days the noise alone leaves more than"),
    ],
)
def test_a_missed_goal_states_what_is_possible_in_the_units_of_the_files(goals, sizes, words):
    plan = plan_measurement(_run(goals, {"force_constant": {"common": "1 %"}}), MOTION)
    texts = _shown(plan)[1]
    assert words in texts
    assert re.findall(r"([\d.]+) kg", texts) == sizes
    view = plan_view(RunFolder(Path(), {}, _run({}), results={PlanResult: plan}))
    (table,) = (block for block in view.blocks if isinstance(block, ReportTable))
    assert {column.digits for column in table.columns if column.title.startswith("σ")} == {3}


@pytest.mark.parametrize(("percent", "words"), [(2.5, "σ −2.5 %"), (np.nan, "criterion +5.2 %")])
def test_a_limit_helps_in_percent_of_the_standard_deviations(percent, words):
    plan = plan_measurement(_run({"v1": "1 %"}), MOTION)
    stated = replace(plan, limit="strut_speed", limit_gain_percent=5.2, limit_std_percent=percent)
    (fact,) = _shown(stated)[2]
    assert fact.value == limit_title("strut_speed")
    assert fact.note.startswith(f"{words} if")


def _designed(config):
    """What a design of the motion stores of its precision."""
    evaluator = noise_evaluator(config)
    information, samples = experiment_information(evaluator, MOTION, config)
    errors = predicted_errors(config, evaluator, MOTION, information, samples)
    found = precision(evaluator, information, samples, config.run.experiment.periods)
    predicted = PredictedStd(found, found, **tolerance_std(evaluator.names, errors))
    return SimpleNamespace(
        configuration=config,
        trajectory=MOTION,
        parameters=tuple(parameter_precisions(evaluator.robot, predicted, errors)),
        derived=derived_precisions(config, evaluator, errors),
        systematic=predicted.systematic,
    )


@pytest.mark.parametrize(
    ("tolerances", "systematic"), [(None, "auto"), (TOLERANCES, "budget"), (TOLERANCES, "auto")]
)
def test_a_design_answers_the_goals_of_its_run_as_the_plan_does(tolerances, systematic):
    goals = {"mass": "0.6 %", "centre": "0.01 mm", "v1": "0.5 %", "p10": "90 %"}
    config = _run(goals, tolerances, systematic=systematic)
    planned = {one.goal: one for one in plan_measurement(config, MOTION).goals}
    found = goals_of_design(_designed(config))
    assert [goal.goal for goal in found] == list(planned)
    for goal in found:
        plan = planned[goal.goal]
        assert (goal.quantity, goal.unit, goal.source) == (plan.quantity, plan.unit, plan.source)
        assert goal.std == pytest.approx(plan.std, rel=1e-3)
        assert goal.wanted == pytest.approx(plan.wanted)
        if goal.std <= goal.wanted:
            assert goal.reachable
            assert goal.periods == 5 >= plan.periods
        elif goal.reachable:  # estimated tolerances are smaller after further periods
            assert plan.reachable
            assert goal.periods >= plan.periods > 5
            assert goal.periods == plan.periods or systematic == "auto" != tolerances
        else:
            assert goal.floor >= goal.wanted
            assert goal.obstacle
            assert systematic == "auto" or not plan.reachable


@pytest.mark.parametrize(("periods", "named"), [(500, True), (5, False)])
def test_the_screen_of_a_design_answers_its_goals(periods, named):
    """It names the tolerance where that, and not the noise, is the largest source."""
    goals, tolerances = {"mass": "0.7 %", "v1": "90 %"}, {"force_constant": {"common": "1 %"}}
    given = _designed(_run(goals, tolerances, periods=periods, systematic="budget"))
    table, meanings, obstacle = design_goal_blocks(given)
    titles = [one.title for one in table.columns]
    mass, friction = (dict(zip(titles, row, strict=True)) for row in table.rows)
    assert (mass["goal"], mass["measuring"]) == ("mass", "–")
    assert (friction["goal"], friction["periods"]) == ("v1", periods)
    assert table.screen
    assert "v1" in meanings.text
    assert obstacle.screen
    words = f"with {periods} periods the tolerances alone leave σ = 0.163 kg"
    assert words in obstacle.text
    assert ("The largest is force_constant: common." in obstacle.text) is named
    assert "expdesign plan" in obstacle.text


def test_a_design_without_usable_goals():
    assert not [*design_goal_blocks(_designed(_run({})))]
    (text,) = design_goal_blocks(_designed(_run({"mas": "1 %"})))
    assert "no quantity that the design determines" in text.text


def test_a_sweep_has_the_minutes_of_each_goal():
    config = _run({"mass": "0.5 %", "v1": "1e-7 %"})
    plan = plan_measurement(config, MOTION)
    prediction = Prediction.of(config, MOTION)
    found = minutes_to_goals(config, prediction)
    assert found["mass"] == plan.goals[0].minutes
    assert np.isnan(found["v1"])
    once, twice = map(prediction.median_std_percent, (3.0, 6.0))
    assert once == pytest.approx(np.sqrt(2) * twice)
    points = replace(config, run=config.run.model_copy(update={"sweep": {"design.seed": (0,)}}))
    point = GridPoint({"design.seed": 0}, "seed-0", config)
    row = SweptDesign.missing(1, point, "failed", "no motion")
    assert np.isnan(row.minutes(0))
    assert sweep_result(points, [row]).goals == ("mass", "v1")
