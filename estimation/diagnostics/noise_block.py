"""The noise of a recording as lines for the robot file: `noise.yaml`."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.diagnostics.noise_density import NoiseDensity
from estimation.diagnostics.noise_record import NoiseFile, correlation_of

_LEVEL = 0.001
_NOTICEABLE = 0.05
"""Correlation below which it changes nothing that is designed or estimated."""
_CLOSE, _FINE, _COARSE = 0.01, 8, 3
"""Smallest eigenvalue of a correlation that is close to singular; digits then, and otherwise."""
_WIDTH = 78
_KINDS = {"force": ("N", 1.0), "length": ("mm", 1e3)}


def noise_block(noise: NoiseFile, densities: dict[str, NoiseDensity]) -> str:
    """Return `noise:` with units, ready to be pasted into a robot or run file.

    Correlations stand in it where the recording shows any. A spectrum is named in a comment: it is
    a file of its own. What the recording does not show is left out and said.

    Parameters
    ----------
    densities : dict of str to NoiseDensity
        By kind, force or length; without rows where there is none.
    """
    lines = [
        *_comment(
            f"Noise of one sample of the recording {Path(noise.recording).name}, {noise.rows} "
            f"samples {'at rest' if noise.at_rest else f'in {noise.periods:.4g} periods'}. For the "
            "robot file or the run file, in place of the `noise:` there.",
            "",
        ),
        *(
            _comment(
                "In motion it may be larger: a recording of any motion that repeats tells.", ""
            )
            if noise.at_rest
            else ()
        ),
        "noise:",
    ]
    freedoms = {"force": noise.force_freedom, "length": noise.length_freedom}
    covariances = {"force": noise.force_covariance, "length": noise.length_covariance}
    for kind, (unit, factor) in _KINDS.items():
        covariance = covariances[kind]
        std = np.sqrt(np.diag(covariance))
        if not np.all(std > 0):
            still = np.flatnonzero(std == 0) + 1
            where = f"actuator{'s' * (len(still) > 1)} {', '.join(map(str, still))}"
            lines += _comment(
                f"{kind}_std: the {kind}s do not change at all ({where}). Take the resolution of "
                "their measurement over the square root of 12"
            )
            continue
        sizes = ", ".join(f"{factor * size:.4g} {unit}" for size in std)
        lines.append(f"  {kind}_std: [{sizes}]")
        lines += _correlation(kind, covariance, freedoms[kind])
        lines += _memory(noise, kind, densities[kind])
    return "\n".join(lines) + "\n"


def _correlation(kind: str, covariance: Array, freedom: float) -> list[str]:
    correlation = correlation_of(covariance)
    upper = np.abs(correlation[np.triu_indices(len(correlation), 1)])
    seen = scipy.stats.norm.isf(_LEVEL / len(upper) / 2) / np.sqrt(freedom)
    if np.max(upper) <= max(seen, _NOTICEABLE):
        return []
    # Rounding must leave it positive definite.
    digits = _COARSE if np.linalg.eigvalsh(correlation)[0] > _CLOSE else _FINE
    rows = [", ".join(f"{value:.{digits}f}" for value in row) for row in correlation]
    return [f"  {kind}_correlation:", *(f"    - [{row}]" for row in rows)]


def _memory(noise: NoiseFile, kind: str, density: NoiseDensity) -> list[str]:
    test = getattr(noise.whiteness, f"{kind}_noise")
    hum = any(line.quantity == kind for line in noise.hum)
    if not len(density.frequency) or not (hum or (test is not None and np.any(test.failed))):
        return []
    why = "hums" if hum else "is not white"
    return _comment(
        f"The noise of the {kind}s {why}. With tables/{kind}_spectrum.csv of this folder beside "
        f"the robot file: {kind}_spectrum: {kind}_spectrum.csv"
    )


def _comment(text: str, margin: str = "  ") -> list[str]:
    start = f"{margin}# "
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=start,
        subsequent_indent=start,
        break_long_words=False,
        break_on_hyphens=False,
    )
