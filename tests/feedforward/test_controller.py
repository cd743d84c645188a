"""The controller of a strut on a mass by itself, and at the limit of its force."""

import numpy as np
import pytest

from estimation.feedforward.closed_loop import Controller, ControllerState
from expdesign.configuration.experiment import FeedforwardSection

MASSES = np.array([1.0, 2.0, 4.0, 7.0, 10.0, 20.0])
NONE = (np.full(6, -np.inf), np.full(6, np.inf))
STILL = ControllerState(None, np.zeros((1, 6)), np.zeros((1, 6)))


def controller(step=1e-4, limit=NONE, **section):
    return Controller.of(FeedforwardSection(**section), MASSES, step, limit)


def moved(law, duration, disturbance=0.0, start=1e-3):
    """Return the places of six free masses over time, (T, 6), exactly between the samples."""
    place, speed, kept, found = np.full(6, start), np.zeros(6), STILL, []
    for _ in range(round(duration / law.step)):
        found.append(place)
        forces, _, kept = law.command(kept, -place[None], np.zeros((1, 6)))
        pushed = (forces[0] + disturbance) / MASSES
        place = place + law.step * speed + law.step**2 / 2 * pushed
        speed = speed + law.step * pushed
    return np.array(found)


@pytest.mark.parametrize(("bandwidth", "damping"), [(10.0, 0.2), (5.0, 0.5)])
def test_a_free_mass_swings_as_is_stated(bandwidth, damping):
    law = controller(bandwidth=bandwidth, damping=damping, integral=0, filter=5000)
    places = moved(law, 0.5)
    times = law.step * np.arange(len(places))
    frequency = 2 * np.pi * bandwidth
    swing = frequency * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * frequency * times)
    expected = decay * (np.cos(swing * times) + damping * frequency / swing * np.sin(swing * times))
    for own in places.T:
        np.testing.assert_allclose(own / 1e-3, expected, rtol=0, atol=0.02)


def test_only_the_integral_action_bears_a_lasting_force():
    lasting = 12.0
    without, with_it = (
        moved(controller(integral=corner), 3.0, lasting, start=0.0)[-1] for corner in (0, 1.0)
    )
    np.testing.assert_allclose(without, lasting / controller().stiffness, rtol=1e-6)
    np.testing.assert_allclose(with_it, 0, atol=1e-3 * without.min())


def test_a_force_at_its_limit_is_told_and_the_integral_waits():
    law = controller(limit=(np.full(6, -5.0), np.full(6, 5.0)))
    error = np.array([[1e-6, 1.0, -1.0, 0.0, 1e-6, 1e-6]])
    forces, limited, kept = law.command(STILL, error, np.zeros((1, 6)))
    np.testing.assert_array_equal(limited, [[False, True, True, False, False, False]])
    np.testing.assert_array_equal(forces[0, 1:3], [5, -5])
    np.testing.assert_array_equal(kept.integral[0, 1:3], 0)
    assert np.all(kept.integral[0, [0, 4, 5]] > 0)


def test_feed_forward_passes_as_it_is():
    forces, _, _ = controller().command(STILL, np.zeros((1, 6)), np.arange(6.0)[None])
    np.testing.assert_array_equal(forces[0], np.arange(6))
