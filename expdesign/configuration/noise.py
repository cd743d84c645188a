"""`noise:` of robot and run: the section, and the covariances and spectra that follow from both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration.document import Located, absolute
from expdesign.configuration.errors import InputError, Problem, refusal
from expdesign.configuration.fields import exactly, read_only
from expdesign.configuration.noise_spectrum import (
    FROM_TEXT,
    SPECTRUM_FORMS,
    ForceSpectrum,
    LengthSpectrum,
    resolve_spectrum,
)
from expdesign.configuration.quantity import (
    Force,
    ForceVariance,
    Length,
    LengthVariance,
    Number,
    Positive,
)
from expdesign.configuration.section import Section
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import NoiseSpectrum

NOISE_FROM_DATA = "`expdesign noise RUN.yaml --data FILE` makes it from a recording at rest"
"""Advice for a run without noise."""

_FAMILIES = ("force", "length")
_TOLERANCE = 1e-9
_SMALLEST_EIGENVALUE = 1e-10

_VALUES = exactly(ACTUATORS, "values")
_ROWS = exactly(ACTUATORS, "rows")
_Correlation = Annotated[tuple[Annotated[tuple[Number, ...], _VALUES], ...], _ROWS]
_ForceCovariance = Annotated[tuple[Annotated[tuple[ForceVariance, ...], _VALUES], ...], _ROWS]
_LengthCovariance = Annotated[tuple[Annotated[tuple[LengthVariance, ...], _VALUES], ...], _ROWS]


def _keys(family: str) -> tuple[str, str, str]:
    return f"{family}_std", f"{family}_correlation", f"{family}_covariance"


class NoiseDescription(Section):
    """Noise of one sample of the actuators, and its distribution over the frequencies.

    The size is a standard deviation with an optional correlation (default: none), or a covariance;
    without either, that of a spectrum's table. Robot and run together must have the standard
    deviation of a correlation.
    """

    force_std: Annotated[tuple[Annotated[Force, Positive], ...], _VALUES] | None = None
    force_correlation: _Correlation | None = None
    force_covariance: _ForceCovariance | None = None
    force_spectrum: Annotated[ForceSpectrum | None, FROM_TEXT] = None
    """White noise by default."""
    length_std: Annotated[tuple[Annotated[Length, Positive], ...], _VALUES] | None = None
    length_correlation: _Correlation | None = None
    length_covariance: _LengthCovariance | None = None
    length_spectrum: Annotated[LengthSpectrum | None, FROM_TEXT] = None

    @model_validator(mode="after")
    def _check_one_size(self) -> NoiseDescription:
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
    """Covariances of one sample, (6, 6), symmetric positive definite; None: unknown."""

    force_covariance: Array | None
    """N²."""
    length_covariance: Array | None
    """m²."""
    force_spectrum: NoiseSpectrum | None = None
    length_spectrum: NoiseSpectrum | None = None
    """With these covariances of one sample; None for white noise."""


def resolve_noise(
    sources: Sequence[Located[NoiseDescription]], sampling: float | None = None
) -> tuple[NoiseDescription | None, ResolvedNoise | None, list[Problem]]:
    """Merge the noise of robot and run.

    Parameters
    ----------
    sources : sequence of Located[NoiseDescription]
        Later ones override earlier ones by key. A later covariance replaces an earlier standard
        deviation and correlation, a later standard deviation or correlation an earlier covariance,
        and a later spectrum with a size all of them.
    sampling : float, optional
        Sampling of the experiment, Hz: a hum above half of it is a problem.

    Returns
    -------
    description, noise
        The merged section and its covariances; None without sources or with problems.
    problems
    """
    if not sources:
        return None, None, []
    merged: dict[str, Any] = {}
    places: dict[str, Located[NoiseDescription]] = {}
    for source in sources:
        given = {k: v for k, v in source.value if v is not None}
        for family in _FAMILIES:
            std, correlation, covariance = _keys(family)
            spectrum = given.get(f"{family}_spectrum")
            sized = spectrum is not None and spectrum.has_size and std not in given
            if covariance in given or sized:
                merged.pop(std, None)
                merged.pop(correlation, None)
            if sized or std in given or correlation in given:
                merged.pop(covariance, None)
        merged |= given
        places |= dict.fromkeys(given, source)
    found = [_resolve_family(family, merged, places) for family in _FAMILIES]
    problems = [problem for _, _, problems in found for problem in problems]
    if sampling is not None:
        problems += _aliased_hums(merged, places, sampling)
    if problems:
        return None, None, problems
    (forces, force_spectrum, _), (lengths, length_spectrum, _) = found
    resolved = ResolvedNoise(forces, lengths, force_spectrum, length_spectrum)
    return NoiseDescription(**merged), resolved, []


def _resolve_family(
    family: str, merged: dict[str, Any], places: dict[str, Located[NoiseDescription]]
) -> tuple[Array | None, NoiseSpectrum | None, list[Problem]]:
    """Return covariance and spectrum of a family; replace the name of a table by its content."""
    key = f"{family}_spectrum"
    covariance = _covariance(family, merged, places)
    if isinstance(covariance, Problem):
        return None, None, [covariance]
    if key not in merged:
        return covariance, None, []
    place, named = places[key], merged[key].file
    try:
        merged[key] = merged[key].with_table(place.document.folder)
        spectrum = resolve_spectrum(merged[key], covariance)
    except InputError as error:
        file = absolute(str(named), place.document.folder)
        problems = list(error.problems)
        if not file.is_file():  # the fault is at the key with its name
            problems = [
                place.problem((key,), f"{file}: {p.message}", SPECTRUM_FORMS) for p in problems
            ]
        return None, None, problems
    except ValueError as error:
        allowed = f"a {family}_std or {family}_covariance that fits it"
        return None, None, [place.problem((key,), str(error), allowed)]
    if spectrum is not None:
        covariance = read_only(spectrum.covariance)
    return covariance, spectrum, []


def _covariance(
    family: str, merged: dict[str, Any], places: dict[str, Located[NoiseDescription]]
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
        wrong = _covariance_fault(shape)
        matrix = (shape + shape.T) / 2 * np.outer(scale, scale)
        is_correlation = np.max(np.abs(np.diag(shape) - 1)) <= _TOLERANCE
        finite = np.all(np.isfinite(matrix)) and np.all(np.diag(matrix) > 0)
    if wrong is None and name != covariance and not is_correlation:
        wrong = "the diagonal of a correlation is not 1"
    if wrong is None and not finite:
        wrong = "the squares of the values are too large or too small"
    if wrong is not None:
        return places[name].problem((name,), wrong, "a symmetric positive definite matrix")
    return read_only(matrix)


def _covariance_fault(matrix: Array) -> str | None:
    """Return the reason why a matrix is not a covariance, None for a covariance."""
    diagonal = np.diag(matrix)
    if np.any(diagonal <= 0):
        j = int(np.argmax(diagonal <= 0)) + 1
        return f"not positive definite: the entry [{j}][{j}] is {diagonal[j - 1]:g}"
    # The scaled matrix is free of units and of the struts' magnitudes.
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


def _aliased_hums(
    merged: dict[str, Any], places: dict[str, Located[NoiseDescription]], sampling: float
) -> Iterator[Problem]:
    """Yield problems of hums above half of the sampling."""
    for key in [f"{family}_spectrum" for family in _FAMILIES if f"{family}_spectrum" in merged]:
        for number, line in enumerate(merged[key].hum):
            if reason := aliasing_of(line.frequency, sampling):
                allowed = (
                    f"a frequency below {sampling / 2:g} Hz, or an experiment.sampling above "
                    f"{2 * line.frequency:g} Hz"
                )
                yield places[key].problem((key, "hum", number, "frequency"), reason, allowed)


def aliasing_of(frequency: float, sampling: float) -> str:
    """Describe the alias of a sinusoid, both in Hz; empty below half of the sampling.

    Examples
    --------
    >>> aliasing_of(300.0, 500.0)
    'a hum of 300 Hz is not below half of the sampling, 250 Hz: its samples are those of 200 Hz'
    """
    if 2 * frequency < sampling:
        return ""
    alias = abs(frequency - round(frequency / sampling) * sampling)
    return (
        f"a hum of {frequency:g} Hz is not below half of the sampling, {sampling / 2:g} Hz: its "
        f"samples are those of {alias:g} Hz"
    )
