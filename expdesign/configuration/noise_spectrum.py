"""`noise.force_spectrum` and `noise.length_spectrum`: the noise's distribution over frequencies.

A spectrum is autoregressive, has a table of densities as from `expdesign noise`, or is white, with
bands and hums. A resolved configuration contains the table itself.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from constraints.arrays import Array
from expdesign.configuration.document import Document, absolute, read_text
from expdesign.configuration.errors import InputError, Key, refusal
from expdesign.configuration.fields import FilledText, at_least, exactly, per_strut
from expdesign.configuration.quantity import (
    NUMBER,
    Force,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
    Share,
)
from expdesign.configuration.section import RESOLVED, Section, validate
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

_LARGEST_FILE = 4 * 1024 * 1024
_MOST_ROWS = 500
_MOST_COEFFICIENTS = 10
_MOST_LINES = 100
_SMALLEST = 1e-9
_FIRST_LINE = 2

_Six = Annotated[tuple[Annotated[Number, NotNegative], ...], exactly(ACTUATORS, "values")]
_Positive = Annotated[tuple[Annotated[Number, Positive], ...], exactly(ACTUATORS, "values")]
_Pairs = Annotated[tuple[Number, ...], exactly(2 * len(PAIRS), "values")]


class SpectrumTable(Section):
    """A density at increasing frequencies, the last of which is half of the sampling."""

    frequency: Annotated[
        tuple[Annotated[Frequency, NotNegative], ...], at_least(2, "frequencies", _MOST_ROWS)
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
            reason = (
                f"row {row + 1}: {self.frequency[row]:g} Hz follows {self.frequency[row - 1]:g}"
            )
            raise refusal(f"{reason} Hz", "increasing frequencies", key=FREQUENCY)
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


class ForceHum(Section):
    """A hum in the forces."""

    frequency: Annotated[Frequency, Positive]
    amplitude: Annotated[tuple[Annotated[Force, NotNegative], ...], per_strut("amplitudes")]
    """N."""


class LengthHum(Section):
    """A hum in the lengths."""

    frequency: Annotated[Frequency, Positive]
    amplitude: Annotated[tuple[Annotated[Length, NotNegative], ...], per_strut("amplitudes")]
    """m."""


class NoiseBand(Section):
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


class _Spectrum(Section):
    ar: Annotated[tuple[tuple[float, ...], ...] | None, BeforeValidator(_read_coefficients)] = None
    """Autoregressive coefficients of every actuator, at the experiment's sampling."""
    file: FilledText | None = None
    """A file with densities."""
    table: Annotated[SpectrumTable | None, RESOLVED] = None
    """Content of such a file."""
    band: Annotated[tuple[NoiseBand, ...], BeforeValidator(_read_lines)] = ()
    """Bands with a share of the noise."""

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

    def with_table(self, folder: Path) -> Self:
        """Return the spectrum with the content of its file; a relative path starts from a folder.

        Raises
        ------
        InputError
            The file is missing or invalid.
        """
        if self.file is None:
            return self
        table = read_spectrum_table(absolute(self.file, folder))
        return self.model_copy(update={"file": None, "table": table})


class ForceSpectrum(_Spectrum):
    """The spectrum of the forces' noise."""

    hum: Annotated[tuple[ForceHum, ...], BeforeValidator(_read_lines)] = ()
    """Additional lines."""


class LengthSpectrum(_Spectrum):
    """The spectrum of the lengths' noise."""

    hum: Annotated[tuple[LengthHum, ...], BeforeValidator(_read_lines)] = ()
    """Additional lines."""


def _read_spectrum(value: object) -> object:
    if value == WHITE:
        return {}
    if value == {}:
        raise refusal("the spectrum is empty", SPECTRUM_FORMS)
    return {"file": value} if isinstance(value, str) else value


FROM_TEXT = BeforeValidator(_read_spectrum)
"""Accepts a text as the name of a file, and `WHITE` for white noise."""


def resolve_spectrum(
    described: ForceSpectrum | LengthSpectrum, covariance: Array | None
) -> NoiseSpectrum | None:
    """Return the spectrum of a description with its table, None for white noise.

    Parameters
    ----------
    covariance : (6, 6), optional
        Covariance of one sample without the hum; by default that of the table.

    Raises
    ------
    ValueError
        The noise has no size, or is not possible.
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
    """Read a table of densities: commas between the columns, their names in the first line.

    Raises
    ------
    InputError
        Columns or cells are missing, or the values are not those of a spectrum.
    """
    text = read_text(path, _LARGEST_FILE, "a table with commas between the columns")
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
    found, problems = validate(SpectrumTable, data, Document(data, path, lines))
    if found is None:
        raise InputError(problems)
    return found
