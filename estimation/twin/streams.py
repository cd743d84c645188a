"""Random streams: one for each purpose, so that none depends on what else is switched on.

All are spawned from a seed by the key (repetition, purpose). Repetitions count from 1; the key 0
is that of the experiment itself, whose draws all repetitions share.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

_EXPERIMENT = 0


class Shared(IntEnum):
    """What belongs to the experiment and is the same in all its repetitions."""

    TRACKING_ERROR = 0
    DRIFT = 1


class Repeated(IntEnum):
    """What every repetition draws anew."""

    FORCE_NOISE = 0
    LENGTH_NOISE = 1
    OUTLIERS = 2


def experiment_stream(seed: int, purpose: Shared) -> np.random.Generator:
    """Return the stream of what all repetitions share."""
    return _stream(seed, _EXPERIMENT, purpose)


def repetition_stream(seed: int, repetition: int, purpose: Repeated) -> np.random.Generator:
    """Return a stream of one repetition, counted from 1."""
    if repetition < 1:
        raise ValueError(f"repetitions count from 1; there is no repetition {repetition}")
    return _stream(seed, repetition, purpose)


def _stream(seed: int, *key: int) -> np.random.Generator:
    # The child that SeedSequence(seed, spawn_key=key[:1]).spawn() gives at the place key[1].
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
