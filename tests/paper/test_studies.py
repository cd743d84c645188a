"""The three studies of the example: covariances, bias and verdicts."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from estimation.montecarlo.study import Workbench
from estimation.twin import Twin
from examples.paper.designs import Trial, linear_covariances, rigid_body, with_exact_lengths
from examples.paper.identification import (
    CASES,
    CaseResult,
    Identification,
    IdentificationBench,
    bias_claim,
    study_identification,
)
from examples.paper.setting import Setting, TooFewEstimatesError, require_estimates
from examples.paper.validation import (
    ValidationBench,
    choose_cogging,
    choose_factors,
    choose_motions,
    expected_share,
)
from expdesign.configuration import load_run
from expdesign.robot import load_robot
from tests.estimation.cases import ROBOT, STEP, trajectory

pytestmark = pytest.mark.slow

MOTION = trajectory(harmonics=2, seed=2)
SAMPLING = f"{1 / STEP} Hz"
PARAMETERS = 24


class Small(Setting):
    """Few settings: ten periods of the tests' motion."""

    def configuration(self, **sections):
        experiment = {"periods": 10, "sampling": SAMPLING} | sections.pop("experiment", {})
        run = {"name": "case", "robot": self.robot, "workers": 1, "experiment": experiment}
        return load_run(run | sections)


def test_linear_covariances_equal_plain_sums():
    twin = Twin.of(Small().configuration(), MOTION)
    found = linear_covariances(ROBOT, twin)
    times = np.arange(twin.grid.count) * STEP
    states = MOTION.sample(times)
    sigma = ROBOT.description.noise.force_covariance
    normal, middle, full = np.zeros((24, 24)), np.zeros((24, 24)), np.zeros((24, 24))
    for pose, rate, acceleration in zip(states.pose, states.rate, states.acceleration, strict=True):
        a = ROBOT.regressor(pose, rate, acceleration)
        normal += a.T @ a
        middle += a.T @ sigma @ a
        full += a.T @ np.linalg.solve(sigma, a)
    inverse = np.linalg.inv(normal)
    np.testing.assert_allclose(found["ls"], inverse @ middle @ inverse, rtol=1e-7)
    np.testing.assert_allclose(found["gm"], np.linalg.inv(full), rtol=1e-7)
    # Gauss and Markov: nothing linear is better.
    gap = found["ls"] - found["gm"]
    assert np.linalg.eigvalsh(gap / np.sqrt(np.outer(np.diag(gap), np.diag(gap))))[0] > -1e-9


def test_achieved_variances_agree_with_predicted_ones():
    config = Small().configuration(
        experiment={"periods": 3},
        estimate={"harmonics": 2},
        montecarlo={"estimators": ["ls", "gm"]},
    )
    bench = Workbench.of(with_exact_lengths(config), MOTION)
    outcomes = [bench.repeat(number).outcomes for number in range(1, 61)]
    trial = Trial(
        1,
        "d",
        None,
        linear_covariances(ROBOT, bench.twin),
        {"exact": {n: np.array([o[n].values for o in outcomes]) for n in ("ls", "gm")}},
    )
    for name in ("ls", "gm"):
        agreement = trial.agreement("exact", name)
        assert abs(agreement["z"]) < 4
        assert agreement["std_error"] < 0.1
    off = {name: 1.5 * covariance for name, covariance in trial.predicted.items()}
    wrong = replace(trial, predicted=off)
    assert wrong.agreement("exact", "gm")["z"] < -4


def test_rigid_bodies_have_ten_parameters():
    assert rigid_body(ROBOT.parameter_names).sum() == 10


# --- identification -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def identification():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("examples.paper.identification._REPETITIONS", {False: 12})
        return study_identification(Small(workers=1), MOTION)


def test_only_ml_stays_at_the_truth_when_the_information_is_disturbed(identification):
    table = identification.tables["estimates"]
    assert list(table["case"].unique()) == ["undisturbed", "pointwise", "tracking"]
    table = table[table["identified"]]
    assert table["parameter"].nunique() > 15
    worst = table["bias_t"].abs().groupby([table["case"], table["estimator"]]).max()
    for case in ("undisturbed", "pointwise", "tracking"):
        # The largest of two dozen t values with 11 degrees of freedom.
        assert worst[case, "ml"] < 6
    for case in ("pointwise", "tracking"):
        assert worst[case, "gm"] > 10
        assert worst[case, "ls"] > 10


def test_the_hausman_test_shows_a_disturbed_information_matrix(identification):
    table = identification.tables["hausman"]
    disturbed = table.groupby("case")["disturbed"].sum().to_dict()
    # At 1 % jointly and 1 % for any parameter, two of twelve sound ones are one chance in 45.
    assert disturbed.pop("undisturbed") <= 1
    assert disturbed == {"pointwise": 12, "tracking": 12}
    assert table[table["case"] == "tracking"]["harmonics"].min() > MOTION.harmonics


def test_claims_of_the_identification(identification):
    judged = [claim for claim in identification.claims if claim.holds is not None]
    assert len(judged) > 8
    broken = [claim for claim in judged if not claim.holds]
    assert not broken


def simulated_case(rng, experiments, bias, which):
    """Return a disturbed case whose estimates have a known bias."""
    mixing = np.eye(PARAMETERS) + 0.2 * np.tri(PARAMETERS)
    errors = rng.normal(size=(experiments, PARAMETERS)) @ mixing.T
    errors[:, which] += bias * mixing[which] @ np.ones(PARAMETERS)
    one = np.ones(PARAMETERS)
    found = tuple(
        Identification(
            dict.fromkeys(("ls", "gm", "ml"), row), {"ls": one, "gm": one, "ml": one}, None, 3
        )
        for row in errors
    )
    return CaseResult(CASES[1], np.zeros(PARAMETERS), found)


def bias_claims(result):
    names = tuple(f"a{k}" for k in range(PARAMETERS))
    everyone = np.ones(PARAMETERS, dtype=bool)
    return [bias_claim(result, name, names, everyone) for name in ("ls", "gm", "ml")]


def verdicts(result):
    found = zip(("LS", "GM", "ML"), bias_claims(result), strict=True)
    return {name: claim.holds for name, claim in found}


@pytest.mark.parametrize("experiments", [3, 6, 20])
def test_chance_makes_no_bias_in_more_studies_than_stated(experiments):
    rng = np.random.default_rng(5)
    studies = 2000
    alarms = 0
    for _ in range(studies):
        found = verdicts(simulated_case(rng, experiments, 0.0, 0))
        # The same numbers: not unbiased for ML is biased for the others.
        assert found["LS"] == found["GM"] == (not found["ML"])
        alarms += not found["ML"]
    # Stated: at most 1 %; the parameters are correlated, so somewhat less. 20 ± 4.5 by chance.
    assert 4 <= alarms <= 34


def test_a_bias_is_found_with_few_experiments():
    rng = np.random.default_rng(6)
    assert verdicts(simulated_case(rng, 6, 100.0, 3)) == {"LS": True, "GM": True, "ML": False}
    (claim, *_) = bias_claims(simulated_case(rng, 6, 3000.0, 3))
    assert claim.statement == "pointwise, LS: the mean of 6 estimates is biased"
    assert claim.value.startswith("1 of 24 identified parameters are beyond 8.29 ")
    assert "in at most 1 % of such studies (t, 5 degrees of freedom); worst a3, " in claim.value
    assert "of the standard deviations that LS states for one experiment" in claim.value
    assert "e+" not in claim.value


def test_an_experiment_is_the_same_in_every_process(identification):
    bench = IdentificationBench(Small(), MOTION)
    again = bench.repeat(1)["pointwise"].values["gm"]
    table = identification.tables["estimates"]
    found = table[(table["case"] == "pointwise") & (table["estimator"] == "gm")]["value"]
    np.testing.assert_array_equal(again, found)


def test_too_few_estimates_are_no_study():
    assert require_estimates("case", [1, None, 2, 3]) == (1, 2, 3)
    with pytest.raises(TooFewEstimatesError, match="only 2 of 4"):
        require_estimates("case", [1, None, None, 2])


# --- validation -----------------------------------------------------------------------------------


def test_the_validation_names_the_struts_with_cogging_and_wrong_parameters(monkeypatch):
    module = "examples.paper.validation"
    circle = {"motion": "circle", "speed": 0.5, "radius": 0.1}
    cogging = {"amplitude": [0, 0, 40, 50, 0, 0], "pitch": 0.03}
    monkeypatch.setattr(f"{module}.choose_motions", lambda *_: [circle])
    monkeypatch.setattr(f"{module}.choose_cogging", lambda *_: cogging)
    monkeypatch.setattr(f"{module}.choose_factors", lambda *_: {"p10": 1.2, "r_alpha": 0.99})
    bench = ValidationBench(Small(), MOTION)
    rows = pd.DataFrame(row for number in (1, 2, 3) for row in bench.repeat(number))
    right = rows[rows["parameter"] == ""]
    for situation in ("without", "unknown"):
        found = right[right["situation"] == situation]
        assert expected_share(found, bench.amplitudes > 0).hits == 3
    seen = (rows["against"] != "").groupby(rows["parameter"]).sum()
    assert seen["p10"] == 3
    assert seen["r_alpha"] < 3


def test_a_test_that_was_refused_is_no_verdict():
    row = {"run": 1, "situation": "without", "tested": True}
    row |= {f"fails_{j}": False for j in range(1, 7)}
    nobody = np.zeros(6, dtype=bool)
    assert expected_share(pd.DataFrame([row]), nobody).hits == 1
    assert expected_share(pd.DataFrame([row, row | {"tested": False}]), nobody).hits == 0


# --- other robots ---------------------------------------------------------------------------------


def test_the_papers_own_robot_is_validated_as_in_the_paper():
    setting = Setting()
    circle, mirrored = choose_motions(setting, ROBOT)
    assert circle == {"motion": "circle", "radius": 0.15, "speed": 1.0}
    assert mirrored["mirror"] == "xz"
    assert choose_cogging(setting, ROBOT)["amplitude"] == [0.0, 0.0, 14.8, 21.1, 0.0, 0.0]
    factors = choose_factors(setting, ROBOT)
    assert factors.pop("p10") == 1.2
    assert len(factors) == 12
    assert set(factors.values()) == {0.5}
    assert setting.printed("8 of 10") == "8 of 10"


def test_another_robot_makes_a_circle_within_its_limits():
    setting = Setting("linuxcnc")
    robot = load_robot("linuxcnc")
    circle, _ = choose_motions(setting, robot)
    assert 0.05 < circle["radius"] < 0.15
    assert 0 < circle["speed"] < 1.0
    amplitude = choose_cogging(setting, robot)["amplitude"]
    noise = np.sqrt(np.diag(robot.description.noise.force_covariance))
    np.testing.assert_allclose(amplitude, [0, 0, 0.5 * noise[2], 1.1 * noise[3], 0, 0])
    assert setting.printed("8 of 10") == ""
