"""The three studies, small: from the run file to what they show."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.lack_of_fit import LackOfFit
from estimation.montecarlo.repetition import Workbench
from estimation.studies.design_study import DesignStudy, rigid_body
from estimation.studies.design_trials import Trial, linear_covariances
from estimation.studies.identification_study import (
    CASES,
    CaseResult,
    Identification,
    IdentificationStudy,
    bias_claim,
)
from estimation.studies.study import with_exact_lengths
from estimation.studies.validation_runs import Prediction
from estimation.studies.validation_study import ValidationStudy
from estimation.twin import Twin
from expdesign.configuration import InputError, load_run
from expdesign.workers import StoppedError
from tests.estimation.cases import ROBOT, STEP, trajectory

MOTION = trajectory(harmonics=2, seed=2)
SAMPLING = f"{1 / STEP} Hz"


def case(study, **sections):
    return load_run(
        {
            "name": "case",
            "robot": "palida",
            "experiment": {"periods": 10, "sampling": SAMPLING},
            "study": study,
            "workers": 1,
            **sections,
        }
    )


class Stop:
    def __init__(self, after):
        self.after, self.seen = after, []

    def advanced(self, done, total):
        self.seen.append((done, total))

    def stop_requested(self):
        return len(self.seen) >= self.after


def test_linear_covariances_equal_plain_sums():
    twin = Twin.of(case({"kind": "identification"}), MOTION)
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


def test_what_is_achieved_agrees_with_what_is_predicted():
    few = {"periods": 3, "sampling": SAMPLING}
    config = case({"kind": "design"}, experiment=few, estimate={"harmonics": 2}).with_section(
        "montecarlo", estimators=("ls", "gm")
    )
    bench = Workbench.of(with_exact_lengths(config), MOTION)
    outcomes = [bench.repeat(number).outcomes for number in range(1, 61)]
    trial = Trial(
        1,
        "d",
        None,
        linear_covariances(ROBOT, bench.twin),
        {"exact": {n: np.array([o[n].values for o in outcomes]) for n in ("ls", "gm")}},
        {"exact": 0},
    )
    for name in ("ls", "gm"):
        agreement = trial.agreement("exact", name)
        assert abs(agreement.z) < 4
        assert agreement.std_error < 0.1
    off = {name: 1.5 * covariance for name, covariance in trial.predicted.items()}
    wrong = replace(trial, predicted=off)
    assert wrong.agreement("exact", "gm").z < -4


def test_rigid_bodies_and_friction_are_told_apart():
    assert rigid_body(ROBOT.parameter_names).sum() == 10


@pytest.fixture(scope="module")
def identification():
    return IdentificationStudy.run(case({"kind": "identification", "repetitions": 12}), MOTION)


def test_only_ml_stays_at_the_truth_when_the_information_is_disturbed(identification):
    by_key = {result.case.key: result for result in identification.cases}
    assert list(by_key) == ["undisturbed", "pointwise", "tracking"]
    which = identification.identified
    assert which.sum() > 15

    def worst(key, name):
        bias, error = by_key[key].bias(name)
        return np.max(np.abs(bias / error)[which])

    for key in by_key:
        # The largest of two dozen t values with 11 degrees of freedom.
        assert worst(key, "ml") < 6
    for key in ("pointwise", "tracking"):
        assert worst(key, "gm") > 10
        assert worst(key, "ls") > 10


def test_the_hausman_test_tells_a_disturbed_information_matrix(identification):
    said = {result.case.key: result.disturbed for result in identification.cases}
    # At 1 % jointly and 1 % for any parameter, two of twelve sound ones are one chance in 45.
    assert said.pop("undisturbed") <= 1
    assert said == {"pointwise": 12, "tracking": 12}
    harmonics = [e.harmonics for e in identification.cases[2].experiments]
    assert min(harmonics) > MOTION.harmonics


def test_claims_of_the_identification(identification):
    found = list(identification.claims())
    judged = [claim for claim in found if claim.holds is not None]
    assert len(judged) > 8
    broken = [claim for claim in judged if not claim.holds]
    assert not broken


PARAMETERS = 24


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
    return CaseResult(CASES[1], np.zeros(PARAMETERS), found, 0)


def bias_claims(result):
    names = tuple(f"a{k}" for k in range(PARAMETERS))
    everyone = np.ones(PARAMETERS, dtype=bool)
    return [bias_claim(result, name, names, everyone) for name in ("ls", "gm", "ml")]


def verdicts(result):
    found = zip(("LS", "GM", "ML"), bias_claims(result), strict=True)
    return {name: claim.holds for name, claim in found}


@pytest.mark.parametrize("experiments", [3, 6, 20])
def test_chance_makes_no_bias_in_more_studies_than_said(experiments):
    rng = np.random.default_rng(5)
    studies = 2000
    alarms = 0
    for _ in range(studies):
        said = verdicts(simulated_case(rng, experiments, 0.0, 0))
        # The same numbers: not unbiased for ML is biased for the others.
        assert said["LS"] == said["GM"] == (not said["ML"])
        alarms += not said["ML"]
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


def test_the_validation_names_the_struts_with_cogging_and_wrong_parameters():
    config = case(
        {
            "kind": "validation",
            "repetitions": 3,
            "cogging": {"amplitude": [0, 0, 40, 50, 0, 0], "pitch": 0.03},
            "motions": [{"motion": "circle", "speed": 0.5, "radius": 0.1}],
            "wrong": {"p10": 1.2, "r_alpha": 0.99},
        }
    )
    study = ValidationStudy.run(config, MOTION)
    assert study.as_expected("without", 0).hits == 3
    assert study.as_expected("unknown").hits == 3
    assert study.power("p10").hits == 3
    assert study.power("r_alpha").hits < 3
    assert study.tests_against("p10")
    told = list(study.claims())[-2]
    assert told.statement.startswith("a parameter that is wrong on purpose (p10 by 1.2, r_alpha")
    assert told.value.startswith("1 of 2 parameters; tests that fail: ")
    assert "the power is below 80 % for r_alpha (" in told.value


def test_a_parameter_or_motion_that_cannot_be_is_refused():
    general = {"kind": "validation", "repetitions": 3, "wrong": {"sx": 2}}
    with pytest.raises(InputError, match="no parameter 'sx'"):
        ValidationStudy.run(case(general), MOTION)
    recorded = {"kind": "validation", "motions": [{"motion": "file", "file": "x.csv"}]}
    with pytest.raises(InputError, match="cannot be repeated"):
        ValidationStudy.run(case(recorded), MOTION)
    short = {"kind": "validation", "motions": [{"motion": "circle", "periods": 1}]}
    with pytest.raises(InputError, match="no scatter between periods"):
        ValidationStudy.run(case(short), MOTION)


@pytest.mark.parametrize(
    ("study", "sections", "message"),
    [
        ({"repetitions": 24}, {}, "24 repetitions do not give a covariance of 24"),
        ({}, {"estimate": {"fixed": ["p1"]}}, "estimate.fixed"),
        ({}, {"estimate": {"bounds": {"p1": [0, 1]}}}, "estimate.bounds"),
        ({}, {"design": {"parameters": ["p10", "r1"]}}, "design.parameters"),
        ({"shown": ["sx"]}, {}, "no parameter 'sx'"),
    ],
)
def test_what_designs_cannot_be_compared_by_is_refused_before_anything_is_computed(
    study, sections, message
):
    with pytest.raises(InputError, match=message):
        DesignStudy.run(case({"kind": "design", **study}, **sections))


def test_a_test_that_was_refused_is_no_verdict():
    nobody = np.zeros(6, dtype=bool)
    one = Prediction(LackOfFit(p_values=np.ones(6)), None, ())
    assert one.says(nobody)
    assert not replace(one, bias=LackOfFit(refused="one period")).says(nobody)


def test_a_study_that_is_stopped_says_how_far_it_was():
    stop = Stop(after=2)
    config = case({"kind": "identification", "repetitions": 5})
    with pytest.raises(StoppedError, match="2 of 5"):
        IdentificationStudy.run(config, MOTION, stop)
    assert stop.seen == [(1, 5), (2, 5)]
