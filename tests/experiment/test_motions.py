"""Several motions of one experiment: their information adds, whoever is asked."""

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run
from expdesign.experiment.setup import plan_search, probe_motion
from expdesign.trajectory import TrajectoryFile, fourier_keys

_TOLERANCES = {"gravity": "0.1 deg", "force_constant": {"common": "0.5 %", "each": "0.5 %"}}


def _run(**sections):
    about = {"name": "x", "robot": "palida", "trajectory": {"harmonics": 3, "samples": 60}}
    return load_run(about | {"design": {"starts": 1, "hops": 0}} | sections)


@pytest.fixture(scope="module")
def motions():
    plan = plan_search(_run())
    return [probe_motion(plan, number) for number in range(3)]


@pytest.mark.parametrize("systematic", ["none", "auto", "budget"])
def test_information_of_others_adds(motions, systematic):
    """With tolerances these are common to all motions and have their priors once."""
    run = _run(tolerances=_TOLERANCES, estimate={"systematic": systematic})
    alone, both = plan_search(run, ()), plan_search(run, motions[1:])
    own, count = both.evaluator, 60
    whole = sum(own.whole_information(one, count) for one in motions)
    expected = alone.evaluator.judged(whole, count)
    found = own.information(motions[0], count)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.max(expected))
    # The search has other unknowns and smooth friction.
    problem = both.problem
    cost = problem.cost.value(problem.variables.pack(motions[0]), 1e-9, 0.0)
    assert problem.cost.criterion_value(cost) == pytest.approx(own.value(found), rel=1e-5)


def test_gradient_with_others(motions):
    cost = plan_search(_run(tolerances=_TOLERANCES), motions[1:]).problem.cost
    x = cost.variables.pack(motions[0])
    _, slope = cost.gradient(x, 0.05, 0.0)
    direction = np.random.default_rng(1).normal(size=len(x))
    step = 1e-6 * direction
    change = cost.value(x + step, 0.05, 0.0) - cost.value(x - step, 0.05, 0.0)
    assert change / 2e-6 == pytest.approx(float(slope @ direction), rel=1e-5)


def test_others_are_read_from_their_folders(motions, tmp_path):
    for number, motion in enumerate(motions[1:]):
        (tmp_path / f"{number}").mkdir()
        TrajectoryFile(**fourier_keys(motion)).write(tmp_path / f"{number}")
    found = plan_search(_run(design={"others": [str(tmp_path / "0"), str(tmp_path / "1")]}))
    given = plan_search(_run(), motions[1:])
    one, other = (plan.evaluator.information(motions[0], 60) for plan in (found, given))
    np.testing.assert_array_equal(one, other)
    with pytest.raises(InputError, match="nowhere"):
        plan_search(_run(design={"others": [str(tmp_path / "nowhere")]}))
