"""`noise:` of robot and run: the section, and the covariances that follow from both together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration.document import Placed, absolute
from expdesign.configuration.errors import InputError, Problem, refusal
from expdesign.configuration.fields import exactly, read_only
from expdesign.configuration.noise_spectrum import (
    FROM_TEXT,
    SPECTRUM_FORMS,
    ForceSpectrum,
    LengthSpectrum,
    resolved_spectrum,
)
from expdesign.configuration.quantity import (
    Force,
    ForceVariance,
    Length,
    LengthVariance,
    Number,
    Positive,
)
from expdesign.configuration.section import LATER, Section
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise.spectrum import NoiseSpectrum

_FAMILIES = ("force", "length")
_TOLERANCE = 1e-9
_SMALLEST_EIGENVALUE = 1e-10

NOISE_FROM_DATA = "`expdesign noise RUN.yaml --data FILE` makes it from a recording at rest"
"""How to come to it, in words."""

_VALUES = exactly(ACTUATORS, "values")
_ROWS = exactly(ACTUATORS, "rows")
_Correlation = Annotated[tuple[Annotated[tuple[Number, ...], _VALUES], ...], _ROWS]
_ForceCovariance = Annotated[tuple[Annotated[tuple[ForceVariance, ...], _VALUES], ...], _ROWS]
_LengthCovariance = Annotated[tuple[Annotated[tuple[LengthVariance, ...], _VALUES], ...], _ROWS]


def _keys(family: str) -> tuple[str, str, str]:
    return f"{family}_std", f"{family}_correlation", f"{family}_covariance"


class NoiseDescription(Section):
    """Noise of one sample of the actuators, as the YAML states it.

    A standard deviation with an optional correlation (default: none), or a covariance; and how it
    is spread over the frequencies. A table's own size counts where none is given beside it.
    Whether a correlation has its standard deviation is checked after robot and run are merged.
    """

    force_std: Annotated[tuple[Annotated[Force, Positive], ...], _VALUES] | None = None
    force_correlation: _Correlation | None = None
    force_covariance: _ForceCovariance | None = None
    force_spectrum: Annotated[ForceSpectrum | None, FROM_TEXT, LATER] = None
    """Of white noise where none is given."""
    length_std: Annotated[tuple[Annotated[Length, Positive], ...], _VALUES] | None = None
    length_correlation: _Correlation | None = None
    length_covariance: _LengthCovariance | None = None
    length_spectrum: Annotated[LengthSpectrum | None, FROM_TEXT, LATER] = None

    @model_validator(mode="after")
    def _one_of_both_ways(self) -> NoiseDescription:
        for std, correlation, covariance in map(_keys, _FAMILIES):
            given = [key for key in (std, correlation) if getattr(self, key) is not None]
            if getattr(self, covariance) is not None and given:
                raise refusal(
                    f"{covariance} and {given[0]} are both given",
                    f"{covariance}, or a standard deviation with an optional correlation",
                    key=covariance,
                )
        return self


@dataclass(frozen=True, eq=False)
class ResolvedNoise:
    """Covariances of one sample, (6, 6), symmetric positive definite; None where not known."""

    force_covariance: Array | None
    """N²."""
    length_covariance: Array | None
    """m²."""
    force_spectrum: NoiseSpectrum | None = None
    length_spectrum: NoiseSpectrum | None = None
    """With these covariances of one sample; None for white noise."""


def resolve_noise(
    sources: Sequence[Placed[NoiseDescription]], sampling: float | None = None
) -> tuple[NoiseDescription | None, ResolvedNoise | None, list[Problem]]:
    """Merge the noise of robot and run.

    Parameters
    ----------
    sources : sequence of Placed[NoiseDescription]
        Later ones override earlier ones key by key. A later covariance takes the place of an
        earlier standard deviation and correlation, a later standard deviation or correlation
        that of an earlier covariance, a later spectrum that has a size of its own that of all of
        them.
    sampling : float, optional
        Of the experiment, Hz: a hum that it cannot hold is a problem.

    Returns
    -------
    description, noise
        The merged section and its covariances; None without sources or with problems.
    problems
    """
    if not sources:
        return None, None, []
    merged: dict[str, Any] = {}
    places: dict[str, Placed[NoiseDescription]] = {}
    for source in sources:
        given = {k: v for k, v in source.value if v is not None}
        for family in _FAMILIES:
            std, correlation, covariance = _keys(family)
            spectrum = given.get(f"{family}_spectrum")
            sized = spectrum is not None and spectrum.has_size and std not in given
            if covariance in given or sized:
                merged.pop(std, None)
                merged.pop(correlation, None)
            if sized:
                merged.pop(covariance, None)
            if std in given or correlation in given:
                merged.pop(covariance, None)
        merged |= given
        places |= dict.fromkeys(given, source)
    found = [_family(family, merged, places) for family in _FAMILIES]
    problems = [problem for _, _, problems in found for problem in problems]
    if sampling is not None:
        problems += _unsampled(merged, places, sampling)
    if problems:
        return None, None, problems
    (forces, force_spectrum, _), (lengths, length_spectrum, _) = found
    resolved = ResolvedNoise(forces, lengths, force_spectrum, length_spectrum)
    return NoiseDescription(**merged), resolved, []


def _family(
    family: str, merged: dict[str, Any], places: dict[str, Placed[NoiseDescription]]
) -> tuple[Array | None, NoiseSpectrum | None, list[Problem]]:
    """Return covariance and spectrum of a family, and put what a file holds in its place."""
    key = f"{family}_spectrum"
    covariance = _covariance(family, merged, places)
    if isinstance(covariance, Problem):
        return None, None, [covariance]
    if key not in merged:
        return covariance, None, []
    place, named = places[key], merged[key].file
    try:
        merged[key] = merged[key].with_table(place.document.folder)
        spectrum = resolved_spectrum(merged[key], covariance)
    except InputError as error:
        file = absolute(str(named), place.document.folder)
        problems = list(error.problems)
        if not file.is_file():  # the place to look at is where it is named
            problems = [
                place.problem((key,), f"{file}: {p.message}", SPECTRUM_FORMS) for p in problems
            ]
        return None, None, problems
    except ValueError as error:
        allowed = f"{family}_std or {family}_covariance that fit it"
        return None, None, [place.problem((key,), str(error), allowed)]
    if spectrum is not None:
        covariance = read_only(spectrum.covariance)
    return covariance, spectrum, []


def _unsampled(
    merged: dict[str, Any], places: dict[str, Placed[NoiseDescription]], sampling: float
) -> Iterator[Problem]:
    """Name hums that a sampling cannot hold."""
    for key in [f"{family}_spectrum" for family in _FAMILIES if f"{family}_spectrum" in merged]:
        for number, line in enumerate(merged[key].hum):
            if reason := unsampled(line.frequency, sampling):
                allowed = (
                    f"a frequency below {sampling / 2:g} Hz, or an experiment.sampling above "
                    f"{2 * line.frequency:g} Hz"
                )
                yield places[key].problem((key, "hum", number, "frequency"), reason, allowed)


def unsampled(frequency: float, sampling: float) -> str:
    """Return why a sampling holds no sinusoid of this frequency, both Hz; empty where it does."""
    if 2 * frequency < sampling:
        return ""
    folded = abs(frequency - round(frequency / sampling) * sampling)
    return (
        f"a hum of {frequency:g} Hz is not below half of the sampling, {sampling / 2:g} Hz: it is "
        f"sampled as one of {folded:g} Hz"
    )


def _covariance(
    family: str, merged: dict[str, Any], places: dict[str, Placed[NoiseDescription]]
) -> Array | Problem | None:
    std, correlation, covariance = _keys(family)
    if covariance in merged:
        name = covariance
        shape, scale = np.array(merged[covariance], dtype=np.float64), np.ones(ACTUATORS)
    elif std in merged:
        name = correlation if correlation in merged else std
        scale = np.array(merged[std], dtype=np.float64)
        shape = np.array(merged.get(correlation, np.eye(ACTUATORS)))
    elif correlation in merged:
        message = f"{correlation} is given without {std}"
        return places[correlation].problem((correlation,), message, f"{std} with it")
    else:
        return None
    with np.errstate(all="ignore"):
        wrong = _no_covariance(shape)
        matrix = (shape + shape.T) / 2 * np.outer(scale, scale)
        is_correlation = np.max(np.abs(np.diag(shape) - 1)) <= _TOLERANCE
        finite = np.all(np.isfinite(matrix)) and np.all(np.diag(matrix) > 0)
    if wrong is None and name != covariance and not is_correlation:
        wrong = "the diagonal of a correlation is not 1"
    if wrong is None and not finite:
        wrong = "the values are too large or too small to be squared"
    if wrong is not None:
        return places[name].problem((name,), wrong, "a symmetric positive definite matrix")
    return read_only(matrix)


def _no_covariance(matrix: Array) -> str | None:
    """Return why a matrix is no covariance; None when it is one."""
    diagonal = np.diag(matrix)
    if np.any(diagonal <= 0):
        j = int(np.argmax(diagonal <= 0)) + 1
        return f"not positive definite: the entry [{j}][{j}] is {diagonal[j - 1]:g}"
    # Judged free of units and of different magnitudes of the struts.
    scale = np.sqrt(diagonal)
    scaled = matrix / scale / scale[:, None]
    if not np.all(np.isfinite(scaled)):
        return "the entries differ too much in magnitude"
    difference = np.abs(scaled - scaled.T)
    if np.max(difference) > _TOLERANCE:
        i, j = (int(n) for n in np.unravel_index(np.argmax(difference), difference.shape))
        return (
            f"not symmetric: the entry [{i + 1}][{j + 1}] is {matrix[i, j]:g}, "
            f"[{j + 1}][{i + 1}] is {matrix[j, i]:g}"
        )
    smallest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    if smallest < _SMALLEST_EIGENVALUE:
        return f"not positive definite: the smallest eigenvalue of the correlation is {smallest:g}"
    return None
