"""A machine with ball screws: designed for, simulated, identified; and its inertia left out."""

import numpy as np
import pytest
from scipy import stats

import expdesign
from estimation.diagnostics.diagnosis import diagnose
from estimation.identification import estimate_parameters
from estimation.twin import Twin
from expdesign.configuration import load_run
from expdesign.robot import robot_from

LEVEL = 0.999
SCREW = {"screw": {"lead": "5 mm", "inertia": 6.3e-5}}


@pytest.fixture(scope="module")
def mapping(tiny, few_limits):
    """Return a run of PaLiDA on screws that its platform turns, 100 kg along each strut."""
    axes = np.array(few_limits["alpha_axes"]) + 0.2 * np.random.default_rng(1).normal(size=(6, 3))
    limits = {**few_limits["limits"], "strut_speed": 1.0, "strut_acceleration": 15.0}
    terms = [term for term in few_limits["terms"] if term != "passive_friction"]
    robot = {
        **few_limits,
        "name": "on-screws",
        "terms": terms,
        "parameters": {k: v for k, v in few_limits["parameters"].items() if k[:2] != "r_"},
        "drive": SCREW,
        "platform_cardan_axes": axes.tolist(),
        "limits": limits,
    }
    return tiny(
        robot=robot,
        trajectory={"harmonics": 3, "samples": 16},
        design={"starts": 1, "search": "restarts", "max_iterations": 6},
        experiment={"periods": 4, "sampling": "100 Hz"},
        estimate={"estimators": ["gm", "ml"], "harmonics": 3, "noise": "given"},
    )


@pytest.fixture(scope="module")
def designed(mapping, cheaper):
    with cheaper():
        return expdesign.design(mapping)


@pytest.fixture(scope="module")
def measured(mapping, designed):
    return Twin.of(load_run(mapping), designed.trajectory).measurement(1)


@pytest.mark.slow
def test_a_design_predicts_how_well_the_inertia_is_known(mapping, designed):
    robot = robot_from(load_run(mapping).robot)
    assert robot.parameters[robot.parameter_names.index("m_drive")] == pytest.approx(99.5, abs=0.1)
    assert 0 < designed.experiment.std["m_drive"] < 1


def test_the_parameters_are_found(mapping, measured, designed):
    found = estimate_parameters(load_run(mapping), measured, designed.trajectory)
    truth = found.robot.parameters
    limit = stats.chi2.ppf(LEVEL, len(truth))
    for name in ("gm", "ml"):
        one = found.estimates[name]
        error = one.values - truth
        assert error @ np.linalg.solve(one.covariance, error) < limit


@pytest.mark.slow
def test_the_inertia_is_named_where_the_model_lacks_it(mapping, measured, designed):
    direct = mapping["robot"] | {"drive": "direct", "platform_cardan_axes": None}
    found = estimate_parameters(
        load_run(mapping | {"robot": direct}), measured, designed.trajectory
    )
    diagnosis = diagnose(found.robot, found.experiments, found.priors, found.best)
    first, *_ = diagnosis.recordings[0].attribution.effects
    assert (first.kind, first.strut) == ("drive_inertia", None)
    assert first.value == pytest.approx(99.5, rel=0.1)
    assert diagnosis.verdict.status.value == "doubtful"
    assert "inertia of the drives" in diagnosis.verdict.summary
