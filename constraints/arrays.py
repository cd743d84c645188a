"""The array types of all packages: they stand on the lowest floor, which all may import."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers, SI units and radians."""

ComplexArray = NDArray[np.complex128]
"""Lines of a discrete Fourier transform."""

Mask = NDArray[np.bool_]
"""Which entries are meant."""
