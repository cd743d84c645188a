"""Cogging of linear motors: a force periodic in the strut's length."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import Cogging


def cogging_force(lengths: Array, cogging: Cogging) -> Array:
    """Return what cogging adds to the actuator forces: amplitude · sin(2π q/pitch + phase).

    The sign is that of friction in the model: it is the force that the actuator gives beyond the
    model's, Q = A p + c(q). The attraction between magnets and iron that pulls the slider out at
    a length q is therefore −c(q).

    Parameters
    ----------
    lengths : (T, 6)
        True strut lengths q, m.
    cogging : Cogging
        Amplitude in N, pitch in m, phase in rad of every strut.

    Returns
    -------
    (T, 6)
        N.
    """
    amplitude, pitch, phase = (
        np.asarray(values) for values in (cogging.amplitude, cogging.pitch, cogging.phase)
    )
    return amplitude * np.sin(2 * np.pi * lengths / pitch + phase)
