"""`noise:` of robot and run: covariances and spectra, from the section to the resolved noise.

A spectrum is autoregressive, has a table of densities as from `expdesign noise`, or is white, with
bands and hums. A resolved configuration contains the table itself.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, Self, TypeVar

import numpy as np
from pydantic import BeforeValidator, model_validator

from constraints.arrays import Array
from expdesign.configuration import schema
from expdesign.configuration.document import Document, Located, absolute, read_text
from expdesign.configuration.errors import InputError, Key, Problem, collect, refusal
from expdesign.configuration.quantity import (
    NUMBER,
    Force,
    ForceVariance,
    Frequency,
    Length,
    LengthVariance,
    NotNegative,
    Number,
    Positive,
    Share,
)
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.noise import (
    Autoregressive,
    Band,
    Hum,
    NoiseSpectrum,
    SpectralPart,
    Tabulated,
    between,
    is_stable,
)

WHITE = "white"
"""Value of a run without the robot's spectrum."""
SPECTRUM_FORMS = (
    f"{WHITE}, the path of a table such as `expdesign noise` writes, or a mapping with ar, file, "
    "band or hum"
)
"""Accepted spectra, for messages."""
FREQUENCY = "frequency"
DENSITIES = actuator_names("density_")
AMPLITUDES = actuator_names("amplitude_")
PAIRS = tuple((i, j) for i in range(ACTUATORS) for j in range(i))
COHERENCIES = tuple(f"{part}_{i + 1}_{j + 1}" for i, j in PAIRS for part in ("real", "imaginary"))
"""Columns of a table: frequency, Hz; density of every channel, the square of its unit per Hz;
optional amplitudes of hum lines and complex coherencies of every pair of channels."""
_MOST_ROWS = 500
_MOST_COEFFICIENTS = 10
_MOST_LINES = 100
_SMALLEST = 1e-9
_FIRST_LINE = 2
_Six = Annotated[tuple[Annotated[Number, NotNegative], ...], schema.exactly(ACTUATORS, "values")]
_Positive = Annotated[tuple[Annotated[Number, Positive], ...], schema.exactly(ACTUATORS, "values")]
_Pairs = Annotated[tuple[Number, ...], schema.exactly(2 * len(PAIRS), "values")]


class SpectrumTable(schema.Section):
    """A density at increasing frequencies up to half of the sampling."""

    frequency: Annotated[
        tuple[Annotated[Frequency, NotNegative], ...], schema.at_least(2, "frequencies", _MOST_ROWS)
    ]
    density: tuple[_Positive, ...]
    """One-sided, N²/Hz or m²/Hz."""
    amplitude: tuple[_Six, ...] | None = None
    """Amplitude of a sinusoid at the frequency, N or m; zero without one."""
    coherency: tuple[_Pairs, ...] | None = None
    """Real and imaginary parts, pair by pair in the order of `PAIRS`; none: no correlation."""

    @model_validator(mode="after")
    def _check_rows(self) -> SpectrumTable:
        steps = np.diff(self.frequency)
        if np.any(steps <= 0):
            row = int(np.argmax(steps <= 0)) + 1
            before, after = self.frequency[row - 1 : row + 1]
            reason = f"row {row + 1}: {after:g} Hz follows {before:g} Hz"
            raise refusal(reason, "increasing frequencies", key=FREQUENCY)
        for key in ("density", "amplitude", "coherency"):
            values = getattr(self, key)
            if values is not None and len(values) != len(self.frequency):
                reason = f"there are {len(values)} rows for {len(self.frequency)} frequencies"
                raise refusal(reason, "one for each frequency", key=key)
        if self.coherency is not None:
            smallest = np.linalg.eigvalsh(_coherency(self.coherency))[:, 0]
            if np.any(smallest < _SMALLEST):
                row = int(np.argmax(smallest < _SMALLEST))
                reason = f"row {row + 1}: not positive definite at {self.frequency[row]:g} Hz"
                raise refusal(reason, "coherencies of channels that differ", key="coherency")
        return self

    def parts(self) -> tuple[Tabulated | Hum, ...]:
        """Return the density and the hum lines."""
        frequencies, density = np.array(self.frequency), np.array(self.density)
        if frequencies[0] > 0:  # constant below the first frequency
            frequencies, density = np.append(0.0, frequencies), np.vstack([density[:1], density])
        root = np.sqrt(density)
        coherency = np.eye(ACTUATORS, dtype=complex)[None]
        if self.coherency is not None:
            coherency = _coherency(self.coherency)
            coherency = np.concatenate([coherency[:1]] * (len(root) - len(coherency)) + [coherency])
        table = Tabulated(frequencies, coherency * root[:, :, None] * root[:, None, :])
        lines = np.array(self.amplitude or np.zeros((0, ACTUATORS)))
        some = np.any(lines > 0, axis=-1)
        if not np.any(some):
            return (table,)
        return table, Hum.of(np.array(self.frequency)[some], lines[some])


def _coherency(rows: tuple[tuple[float, ...], ...]) -> Any:
    values = np.array(rows).reshape(len(rows), len(PAIRS), 2)
    matrix = np.tile(np.eye(ACTUATORS, dtype=complex), (len(rows), 1, 1))
    for place, (i, j) in enumerate(PAIRS):
        matrix[:, i, j] = values[:, place, 0] + 1j * values[:, place, 1]
        matrix[:, j, i] = matrix[:, i, j].conj()
    return matrix


class ForceHum(schema.Section):
    """A hum of the forces at one frequency."""

    frequency: Annotated[Frequency, Positive]
    amplitude: schema.PerStrut[Annotated[Force, NotNegative]]


class LengthHum(schema.Section):
    """A hum of the lengths at one frequency."""

    frequency: Annotated[Frequency, Positive]
    amplitude: schema.PerStrut[Annotated[Length, NotNegative]]


Hums = TypeVar("Hums", ForceHum, LengthHum)


class NoiseBand(schema.Section):
    """A band about one frequency with a share of the noise."""

    frequency: Annotated[Frequency, Positive]
    """Frequency of the largest density, Hz."""
    width: Annotated[Frequency, Positive]
    """Distance between the frequencies with half of that density, Hz."""
    share: Annotated[Share, Positive]
    """Share of the variance of one sample; the other keys describe the rest."""


_AR = (
    "a coefficient for all actuators, six of them, or a list of coefficients for all or six such "
    "lists"
)


def _read_coefficients(value: object) -> tuple[tuple[float, ...], ...] | None:
    """Return the coefficients of every actuator, from one or six numbers or lists."""
    if value is None:
        return None
    rows = value if isinstance(value, list | tuple) else [value]
    if len(rows) not in (1, ACTUATORS):
        hint = "; the coefficients for all actuators are a nested list: [[a1, a2]]"
        raise refusal(f"there are {len(rows)} values{hint}", _AR)
    found = []
    for row in rows:
        items = row if isinstance(row, list | tuple) else [row]
        numbers = tuple(NUMBER.parse(item) for item in items)
        if not 1 <= len(numbers) <= _MOST_COEFFICIENTS:
            reason = f"there are {len(numbers)} coefficients"
            raise refusal(reason, f"1 to {_MOST_COEFFICIENTS} of them")
        if not is_stable(np.array([numbers])):
            reason = f"noise with {', '.join(f'{a:g}' for a in numbers)} grows without bound"
            raise refusal(
                reason, "a single coefficient between -1 and 1, or a stable set of coefficients"
            )
        found.append(numbers)
    return tuple(found) * (ACTUATORS // len(found))


def _read_lines(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) > _MOST_LINES:
        raise refusal(f"the list has {len(value)} of them", f"{_MOST_LINES} at most")
    return [value] if isinstance(value, dict) else value


class SpectrumDescription(schema.Section, Generic[Hums]):
    """The spectrum of the noise of forces or lengths."""

    ar: Annotated[tuple[tuple[float, ...], ...] | None, BeforeValidator(_read_coefficients)] = None
    """Autoregressive coefficients of every actuator, at the experiment's sampling."""
    file: schema.FilledText | None = None
    """A file with densities."""
    table: Annotated[SpectrumTable | None, schema.RESOLVED] = None
    """Content of such a file."""
    band: Annotated[tuple[NoiseBand, ...], BeforeValidator(_read_lines)] = ()
    """Bands with a share of the noise."""
    hum: Annotated[tuple[Hums, ...], BeforeValidator(_read_lines)] = ()
    """Additional lines."""

    @model_validator(mode="after")
    def _check_bands(self) -> Self:
        if sum(band.share for band in self.band) >= 1:
            reason = "the bands have all of the noise"
            raise refusal(reason, "shares whose sum is below 1", key="band")
        if self.band and self.has_size:
            reason = "a file has the noise of each band already"
            raise refusal(reason, "band with ar, or alone", key="band")
        return self

    @model_validator(mode="after")
    def _check_one_form(self) -> Self:
        given = [key for key in ("ar", "file", "table") if getattr(self, key) is not None]
        if len(given) > 1:
            raise refusal(f"{given[0]} and {given[1]} are both given", "one of them", key=given[1])
        return self

    @property
    def has_size(self) -> bool:
        """True when it has the size of the noise and not only its shape."""
        return self.file is not None or self.table is not None


# Classes with names of their own: a worker process finds them.
class ForceSpectrum(SpectrumDescription[ForceHum]):
    """The spectrum of the noise of the forces."""


class LengthSpectrum(SpectrumDescription[LengthHum]):
    """The spectrum of the noise of the lengths."""


def _read_spectrum(value: object) -> object:
    if value == WHITE:
        return {}
    if value == {}:
        raise refusal("the spectrum is empty", SPECTRUM_FORMS)
    return {"file": value} if isinstance(value, str) else value


FROM_TEXT = BeforeValidator(_read_spectrum)
"""Accepts a text as the name of a file, and `WHITE` for white noise."""


def resolve_spectrum(
    described: SpectrumDescription[Any], covariance: Array | None
) -> NoiseSpectrum | None:
    """Return the spectrum of a description with its table, None for white noise.

    The covariance, (6, 6), is that of one sample without the hum, by default that of the table. A
    `ValueError` gives the reason of an impossible spectrum.
    """
    parts: tuple[SpectralPart, ...]
    if described.table is not None:
        own = described.table.parts()
        if covariance is not None:
            matrix = between(NoiseSpectrum(own).covariance, covariance)
            own = tuple(part.transformed(matrix) for part in own)
        parts = own
    elif described.ar is None and not described.hum and not described.band:
        return None
    elif covariance is None:
        raise ValueError("the spectrum has no size of the noise")
    else:
        rows = described.ar or ((),) * ACTUATORS
        longest = max(map(len, rows))
        filled = np.zeros((ACTUATORS, longest))
        for row, coefficients in zip(filled, rows, strict=True):
            row[: len(coefficients)] = coefficients
        rest = 1 - sum(band.share for band in described.band)
        parts = (Autoregressive.with_covariance(filled, rest * covariance),)
        parts += tuple(
            Band(band.share * covariance, band.frequency, band.width) for band in described.band
        )
    if described.hum:
        frequencies = np.array([line.frequency for line in described.hum])
        parts += (Hum.of(frequencies, np.array([line.amplitude for line in described.hum])),)
    return NoiseSpectrum(parts)


def read_spectrum_table(path: Path) -> SpectrumTable:
    """Read a table of densities: commas between the columns, their names in the first line."""
    text = read_text(path, "a table with commas between the columns")
    names, *rows = [*csv.reader(io.StringIO(text))] or [[]]
    rows = [row for row in rows if row]
    place = {name.strip(): number for number, name in enumerate(names)}
    needed = (FREQUENCY, *DENSITIES)
    optional = [group for group in (AMPLITUDES, COHERENCIES) if any(n in place for n in group)]
    missing = [n for n in (*needed, *(n for group in optional for n in group)) if n not in place]
    if missing:
        allowed = f"{FREQUENCY} in Hz, {DENSITIES[0]} … {DENSITIES[-1]}"
        raise InputError(f"columns are missing: {', '.join(missing)}", path, 1, allowed=allowed)
    if len(rows) > _MOST_ROWS:
        raise InputError(f"there are {len(rows)} rows", path, allowed=f"{_MOST_ROWS} at most")
    short = next((n for n, row in enumerate(rows) if len(row) != len(names)), None)
    if short is not None:
        message = f"the row has {len(rows[short])} cells for {len(names)} columns"
        raise InputError(message, path, short + _FIRST_LINE)

    def block(columns: Sequence[str]) -> list[list[str]]:
        return [[row[place[name]] for name in columns] for row in rows]

    data: dict[str, Any] = {
        FREQUENCY: [row[place[FREQUENCY]] for row in rows],
        "density": block(DENSITIES),
        "amplitude": block(AMPLITUDES) if AMPLITUDES in optional else None,
        "coherency": block(COHERENCIES) if COHERENCIES in optional else None,
    }
    lines: dict[Key, int] = {(key, n): n + _FIRST_LINE for key in data for n in range(len(rows))}
    return schema.validate(SpectrumTable, data, Document(data, path, lines))


NOISE_FROM_DATA = "`expdesign noise RUN.yaml --data FILE` makes it from a recording at rest"
"""Advice for a run without noise."""
_FAMILIES = ("force", "length")
_TOLERANCE = 1e-9
_SMALLEST_EIGENVALUE = 1e-10
_VALUES = schema.exactly(ACTUATORS, "values")
_ROWS = schema.exactly(ACTUATORS, "rows")
_Correlation = Annotated[tuple[Annotated[tuple[Number, ...], _VALUES], ...], _ROWS]
_ForceCovariance = Annotated[tuple[Annotated[tuple[ForceVariance, ...], _VALUES], ...], _ROWS]
_LengthCovariance = Annotated[tuple[Annotated[tuple[LengthVariance, ...], _VALUES], ...], _ROWS]


def _keys(family: str) -> tuple[str, str, str]:
    return f"{family}_std", f"{family}_correlation", f"{family}_covariance"


class NoiseDescription(schema.Section):
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
) -> tuple[NoiseDescription | None, ResolvedNoise | None]:
    """Merge the noise of robot and run: the section, and its covariances with spectra.

    Later sources override earlier ones by key. A later covariance replaces an earlier standard
    deviation and correlation, a later standard deviation or correlation an earlier covariance, and
    a later spectrum with a size all of them. A hum above half of the experiment's sampling, Hz, is
    a problem.
    """
    if not sources:
        return None, None
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
    found, problems = [], list[Problem]()
    for family in _FAMILIES:
        with collect(problems):
            found.append(_resolve_family(family, merged, places, sampling or np.inf))
    if problems:
        raise InputError(problems)
    (forces, force_spectrum), (lengths, length_spectrum) = found
    resolved = ResolvedNoise(forces, lengths, force_spectrum, length_spectrum)
    return NoiseDescription(**merged), resolved


def _resolve_family(
    family: str,
    merged: dict[str, Any],
    places: dict[str, Located[NoiseDescription]],
    sampling: float,
) -> tuple[Array | None, NoiseSpectrum | None]:
    """Return covariance and spectrum of a family; replace the name of a table by its content."""
    covariance, key = _covariance(family, merged, places), f"{family}_spectrum"
    if key not in merged:
        return covariance, None
    place, described = places[key], merged[key]
    spectrum, problems = None, []
    for number, line in enumerate(described.hum):
        if reason := aliasing_of(line.frequency, sampling):
            allowed = (
                f"a frequency below {sampling / 2:g} Hz, or an experiment.sampling above "
                f"{2 * line.frequency:g} Hz"
            )
            problems.append(place.problem((key, "hum", number, "frequency"), reason, allowed))
    if described.file is not None:
        file = absolute(described.file, place.document.folder)
        try:
            table = read_spectrum_table(file)
        except InputError as error:
            if file.is_file():
                raise
            # the fault is at the key with its name
            raise InputError(
                place.problem((key,), f"{file}: {one.message}", SPECTRUM_FORMS)
                for one in error.problems
            ) from None
        described = described.model_copy(update={"file": None, "table": table})
    try:
        spectrum = resolve_spectrum(described, covariance)
    except ValueError as error:
        allowed = f"a {family}_std or {family}_covariance that fits it"
        problems.append(place.problem((key,), str(error), allowed))
    if problems:
        raise InputError(problems)
    merged[key] = described
    return covariance if spectrum is None else schema.read_only(spectrum.covariance), spectrum


def _covariance(
    family: str, merged: dict[str, Any], places: dict[str, Located[NoiseDescription]]
) -> Array | None:
    std, correlation, covariance = _keys(family)
    if covariance in merged:
        name, scale = covariance, np.ones(ACTUATORS)
        shape = np.array(merged[covariance], dtype=np.float64)
    elif std in merged:
        name = correlation if correlation in merged else std
        scale = np.array(merged[std], dtype=np.float64)
        shape = np.array(merged.get(correlation, np.eye(ACTUATORS)))
    elif correlation in merged:
        message = f"{correlation} is given without {std}"
        problem = places[correlation].problem((correlation,), message, f"{std} with it")
        raise InputError(problem)
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
        allowed = "a symmetric positive definite matrix"
        raise InputError(places[name].problem((name,), wrong, allowed))
    return schema.read_only(matrix)


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
