"""`montecarlo:`, repeated simulated experiments."""

from __future__ import annotations

from typing import Annotated

from expdesign.configuration.base import Section
from expdesign.configuration.estimate import Estimators
from expdesign.configuration.scalars import Seed, whole

_LARGEST_REPETITIONS = 10_000_000


class MonteCarloSection(Section):
    """Study of the estimators' bias, spread and coverage.

    Attributes
    ----------
    repetitions : int
    estimators : tuple of {"ls", "gm", "ml"}
    seed : int
        From which the random stream of every repetition is spawned.
    """

    repetitions: Annotated[int, whole(1, _LARGEST_REPETITIONS)] = 400
    estimators: Estimators = ("ls", "gm", "ml")
    seed: Seed = 0
