"""A run and a motion that the tests of the twin share."""

import numpy as np

from expdesign.configuration import load_run
from expdesign.trajectory import FourierTrajectory

TINY = 1e-12


def motion(frequency=0.5, harmonics=3):
    """Return a gentle motion of PaLiDA about its home pose."""
    rng = np.random.default_rng(11)
    sizes = np.array([0.03, 0.03, 0.02, 0.05, 0.05, 0.08])[:, None] / np.arange(1, harmonics + 1)
    return FourierTrajectory.from_displacements(
        2 * np.pi * frequency,
        [0, 0, -0.654, 0, 0, 0],
        sizes * rng.uniform(-1, 1, (6, harmonics)),
        sizes * rng.uniform(-1, 1, (6, harmonics)),
    )


def configuration(noise=None, **experiment):
    """Return a run of PaLiDA; `noise` is one standard deviation of forces and lengths."""
    run = {"name": "twin", "robot": "palida", "experiment": experiment}
    if noise is not None:
        run["noise"] = {
            "force_covariance": (np.eye(6) * noise**2).tolist(),
            "length_covariance": (np.eye(6) * noise**2).tolist(),
        }
    return load_run(run)
