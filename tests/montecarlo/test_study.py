"""The study as a whole: against its own promises, resumed, in parallel, with failures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimation.estimators import UnidentifiableError
from estimation.identification import estimate_parameters
from estimation.kinematics import MotionFitError
from estimation.montecarlo import run_study
from estimation.montecarlo import study as one
from estimation.montecarlo.result import Failure
from estimation.montecarlo.study import study_inputs
from estimation.twin import Twin
from expdesign.configuration import InputError
from expdesign.configuration.robot import load_robot_description
from expdesign.runfolder.manifest import sections_text
from expdesign.stages.registry import stages
from tests.estimation.cases import made_up
from tests.montecarlo.examples import DESIGN, Watcher, repetition_rows, small
from tests.twin.examples import motion


def table(study):
    return repetition_rows(study).to_csv()


def estimated(study, estimator):
    """Return the numbers of the repetitions with an estimate."""
    return [one.number for one in study.repetitions if not one.outcomes[estimator].error]


# --- what a repetition is -------------------------------------------------------------------------


def test_a_repetition_is_an_estimate_of_the_twins_measurement(study):
    configuration = small()
    twin = Twin.of(configuration, DESIGN, configuration.run.montecarlo.seed)
    expected = estimate_parameters(configuration, twin.measurement(3), DESIGN)
    found = study.repetitions[2]
    assert found.number == 3
    assert found.harmonics == 2
    # 240 degrees of freedom are too few to weight with: the robot's noise is taken.
    assert found.freedom == np.inf
    for name in ("gm", "ml"):
        np.testing.assert_array_equal(found.outcomes[name].values, expected[name].values)
        np.testing.assert_array_equal(found.outcomes[name].std, expected[name].std)
        assert found.outcomes[name].iterations == expected[name].iterations


def test_the_seed_is_the_studys_own(study):
    other = run_study(small(1, montecarlo={"seed": 1}), DESIGN)
    first, second = (s.repetitions[0].outcomes["gm"].values for s in (study, other))
    assert not np.allclose(first, second, rtol=1e-9)


def test_statistics_are_about_the_free_parameters():
    study = run_study(small(2, estimate={"fixed": ["p1", "p2"]}), DESIGN)
    assert "p1" not in study.statistics("ml")
    assert len(study.statistics("ml")) == 22
    assert np.all(study.bound_std[:2] == 0)
    assert np.all(study.bound_std[2:] > 0)
    assert not set(study.identified) & {"p1", "p2"}
    assert "p1" not in {row.parameter for row in study.rows}


# --- the bound ------------------------------------------------------------------------------------


def test_the_bound_is_what_ml_states_on_average(study):
    for name, found in study.statistics("ml").items():
        bound = study.bound_std[list(study.truth).index(name)]
        assert found.reported_std == pytest.approx(bound, rel=0.15)


def test_the_bound_counts_all_periods():
    three, twelve = (
        run_study(small(1, experiment={"periods": periods, "sampling": 60}), DESIGN).bound_std
        for periods in (3, 12)
    )
    np.testing.assert_allclose(three / twelve, 2.0, rtol=1e-6)


def test_the_bound_of_a_period_that_is_no_whole_number_of_samples():
    """Nearly as many samples, at other phases: about the same bound."""
    whole = run_study(small(1), DESIGN).bound_std
    odd = run_study(small(1, experiment={"periods": 3, "sampling": 59.87}), DESIGN).bound_std
    np.testing.assert_allclose(odd, whole, rtol=0.03)


def test_harmonics_of_the_tracking_error_are_unknowns_too():
    error = {"position": 1e-6, "angle": 1e-6, "harmonics": [3, 6]}
    known, unknown = (
        run_study(
            small(
                1,
                estimate={"harmonics": harmonics},
                experiment={"periods": 3, "sampling": 60, "tracking_error": tracking},
                noise={"length_std": ["5 mm"] * 6},
            ),
            DESIGN,
        ).bound_std
        for harmonics, tracking in ((2, None), (6, error))
    )
    assert np.all(unknown > known)


def test_an_experiment_that_determines_too_little_is_refused():
    still = motion(0.5, harmonics=1)
    still = type(still).from_displacements(still.omega, still.lambda0, 0 * still.mu, 0 * still.nu)
    with pytest.raises(UnidentifiableError, match="do not determine"):
        run_study(small(1), still)


# --- parallel, resumed, interrupted ---------------------------------------------------------------


def test_only_what_is_missing_is_done(study, tmp_path, monkeypatch):
    journal = tmp_path / "journal"
    first = Watcher(stop_at=2)
    part = run_study(small(), DESIGN, journal, first)
    assert first.seen == [(0, 4), (1, 4), (2, 4)]
    assert part.interrupted
    assert [r.number for r in part.repetitions] == [1, 2]

    done = []
    original = one.Workbench.repeat
    monkeypatch.setattr(
        one.Workbench, "repeat", lambda bench, k: done.append(k) or original(bench, k)
    )
    second = Watcher()
    whole = run_study(small(), DESIGN, journal, second)
    assert done == [3, 4]
    assert second.seen == [(2, 4), (3, 4), (4, 4)]
    assert not whole.interrupted
    assert table(whole) == table(study)

    done.clear()
    assert table(run_study(small(), DESIGN, journal)) == table(study)
    fewer = run_study(small(2), DESIGN, journal)
    assert done == []
    assert [r.number for r in fewer.repetitions] == [1, 2]
    assert table(fewer) == table(part)


@pytest.mark.parametrize(
    "change",
    [
        {"montecarlo": {"seed": 5}},
        {"montecarlo": {"estimators": ["gm"]}},
        {"estimate": {"harmonics": 3}},
        {"experiment": {"periods": 4, "sampling": 60}},
        {"noise": {"force_std": [1, 1, 1, 1, 1, 1]}},
    ],
    ids=str,
)
def test_other_inputs_are_another_study(change):
    assert study_inputs(small(**change), DESIGN) != study_inputs(small(), DESIGN)


@pytest.mark.parametrize(
    "change",
    [
        {"repetitions": 400},
        {"workers": 2},
        {"estimate": {"estimators": ["ls"]}},
        {"name": "other"},
        {"design": {"seed": 3}},
    ],
    ids=str,
)
def test_what_a_repetition_does_not_depend_on(change):
    assert study_inputs(small(**change), DESIGN) == study_inputs(small(), DESIGN)


def test_a_study_of_voltages_is_another_one():
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    motor = {"force_constant": "90 N/A", "resistance": "2 ohm"}
    robot = palida | {"drive": {"motor": motor}}
    forces, volts = (small(robot=robot, data=data) for data in ({}, {"units": {"Q": "V"}}))
    assert study_inputs(forces, DESIGN) != study_inputs(volts, DESIGN)
    sections = stages()["montecarlo"].sections
    assert sections_text(forces, sections) != sections_text(volts, sections)


# --- failures and bad input -----------------------------------------------------------------------


def test_failures_are_recorded_with_their_reason(monkeypatch, tmp_path):
    prepare, run = one.prepare_experiment, one.run_estimators

    def sometimes(configuration, robot, data, design):
        if data.source.endswith("repetition 2"):
            raise MotionFitError("no pose has the measured lengths")
        return prepare(configuration, robot, data, design)

    def ml_fails_once(robot, experiments, knowledge, wanted):
        if "ml" in wanted and calls.setdefault("ml", len(calls)) == 0 and calls["left"] > 0:
            calls["left"] -= 1
            raise UnidentifiableError(("p1",))
        return run(robot, experiments, knowledge, wanted)

    calls = {"ml": 0, "left": 2}  # all together, and ml alone
    monkeypatch.setattr(one, "prepare_experiment", sometimes)
    monkeypatch.setattr(one, "run_estimators", ml_fails_once)
    journal = tmp_path / "journal"
    study = run_study(small(3), DESIGN, journal)
    assert study.estimators["gm"].failures == (Failure(2, "no pose has the measured lengths"),)
    assert [each.repetition for each in study.estimators["ml"].failures] == [1, 2]
    assert "do not determine p1" in study.estimators["ml"].failures[0].reason
    assert estimated(study, "gm") == [1, 3]
    assert estimated(study, "ml") == [3]
    found = repetition_rows(study)
    assert len(found) == 6
    failed = found[found["failure"] != ""]
    assert list(zip(failed["repetition"], failed["estimator"], strict=True)) == [
        (1, "ml"),
        (2, "gm"),
        (2, "ml"),
    ]
    assert failed["p1"].isna().all()
    assert [row.estimates for row in study.rows] == [2] * 24 + [1] * 24
    assert table(run_study(small(3), DESIGN, journal)) == table(study)


def test_what_is_not_converged_counts(study, monkeypatch):
    outcome = one.RepetitionEstimate(np.full(24, np.inf), np.ones(24))
    estimate_ = study_estimate(outcome)
    assert one._outcome(estimate_).error == "the estimate is not finite"
    kept = one._outcome(study_estimate(one.RepetitionEstimate(np.ones(24), np.ones(24))))
    assert not kept.error
    assert not kept.converged


def study_estimate(outcome):
    made = made_up(outcome.values, outcome.std)
    return replace(made, estimator="ml", iterations=40, converged=False, status="stopped")


def test_ml_without_a_fitted_motion_is_refused():
    with pytest.raises(InputError) as error:
        run_study(small(estimate={"harmonics": "auto", "differentiation": "central"}), DESIGN)
    assert error.value.problems[0].key == "montecarlo.estimators"


def test_bad_input_that_shows_in_a_repetition(tmp_path):
    configuration = small(
        2,
        estimate={"noise": "estimated"},
        experiment={"periods": 1, "sampling": 60},
    )
    with pytest.raises(InputError) as error:
        run_study(configuration, DESIGN, tmp_path / "journal")
    assert error.value.problems[0].key == "estimate.noise"
    assert not (tmp_path / "journal").exists()


# --- what it says of the estimators ---------------------------------------------------------------


@pytest.mark.slow
def test_the_estimators_keep_their_promises():
    count = 60
    study = run_study(small(count, montecarlo={"estimators": ["ls", "gm", "ml"]}), DESIGN)
    for name in ("ls", "gm", "ml"):
        pooled = study.estimators[name].pooled
        assert len(estimated(study, name)) == count
        # 24 parameters: a limit that chance breaks once in a thousand studies.
        assert pooled.largest_bias_t < stats.t.ppf(1 - 1e-3 / 48, count - 1)
        assert pooled.coverage == pytest.approx(0.95, abs=4 * pooled.coverage_std_error)
        for found in study.statistics(name).values():
            # Spread over the promised one: χ² with K − 1 degrees of freedom.
            chi_square = (count - 1) / found.reported_over_spread**2
            assert 1e-5 < stats.chi2.cdf(chi_square, count - 1) < 1 - 1e-5
    ml = study.estimators["ml"].pooled
    assert ml.rmse_over_bound == pytest.approx(1.0, abs=4 * ml.rmse_over_bound_std_error)
    assert study.estimators["ls"].pooled.rmse_over_bound > ml.rmse_over_bound


@pytest.mark.slow
def test_pointwise_differentiation_is_biased():
    study = run_study(
        small(
            30,
            estimate={"harmonics": "auto", "differentiation": "central"},
            experiment={"periods": 3, "sampling": 600},
            montecarlo={"estimators": ["gm"]},
        ),
        DESIGN,
    )
    assert {r.harmonics for r in study.repetitions} == {None}
    assert study.estimators["gm"].pooled.largest_bias_t > 10
    assert study.estimators["gm"].pooled.coverage < 0.9
