import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.twin.disturbances import execute_design
from expdesign.configuration.experiment import TrackingError
from tests.twin.examples import motion


def executed(seed=0, design=None, **error):
    return execute_design(design or motion(), TrackingError(**error), np.random.default_rng(seed))


@given(
    position=st.floats(1e-5, 0.01),
    angle=st.floats(1e-5, 0.05),
    first=st.integers(1, 20),
    more=st.integers(0, 10),
    seed=st.integers(0, 2**63 - 1),
)
def test_the_deviation_has_the_size_and_the_harmonics_given(position, angle, first, more, seed):
    design, last = motion(), first + more
    made = executed(seed, position=position, angle=angle, harmonics=[first, last])
    times = design.sample_times(8 * (last + 4))
    deviation = made.sample(times).pose - design.sample(times).pose
    rms = np.sqrt(np.mean(deviation**2, axis=0))
    np.testing.assert_allclose(rms, np.repeat([position, angle], 3), rtol=1e-7)
    spectrum = np.abs(np.fft.rfft(deviation, axis=0)) / len(times)
    outside = np.delete(spectrum, slice(first, last + 1), axis=0)
    assert outside.max() < 1e-10 * spectrum.max() + 1e-15


def test_it_is_a_trajectory_with_consistent_derivatives():
    made = executed(angle=0.002)
    assert made.harmonics == 15
    assert made.omega == motion().omega
    step = 1e-5
    times = np.linspace(0, 2, 50)
    ahead, behind, here = (made.sample(times + d) for d in (step, -step, 0))
    np.testing.assert_allclose((ahead.pose - behind.pose) / (2 * step), here.rate, atol=1e-6)
    np.testing.assert_allclose(
        (ahead.rate - behind.rate) / (2 * step), here.acceleration, atol=1e-4
    )


def test_a_deviation_within_the_harmonics_of_the_design():
    design = motion()
    made = executed(design=design, harmonics=[2, 2])
    assert made.harmonics == design.harmonics
    np.testing.assert_array_equal(made.mu[:, [0, 2]], design.mu[:, [0, 2]])
    assert np.all(made.mu[:3, 1] != design.mu[:3, 1])
    np.testing.assert_array_equal(made.mu[3:], design.mu[3:])


@pytest.mark.parametrize("error", [None, TrackingError(position=0, angle=0)])
def test_without_an_error_the_design_is_executed(error):
    design = motion()
    assert execute_design(design, error, np.random.default_rng(0)) is design


def test_another_seed_is_another_deviation():
    assert not np.array_equal(executed(0).mu, executed(1).mu)
    np.testing.assert_array_equal(executed(0).mu, executed(0).mu)
    doubled = executed(0, position=0.002)
    design = np.pad(motion().mu, ((0, 0), (0, 12)))
    np.testing.assert_allclose(doubled.mu - design, 2 * (executed(0).mu - design), atol=1e-15)
