"""Analysis of the noise of a recording, without model or parameters (the paper's Figs. 4, 5).

All results derive from contrasts between the periods: tests, spectra, a search for a hum of the
mains, and the lines of `noise.yaml` for the robot file.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy

from constraints.arrays import Array, Mask
from estimation.diagnostics import noise_result
from estimation.diagnostics.finding import Assumption, Finding
from estimation.diagnostics.noise_tests import noise_tests
from estimation.diagnostics.verdict import noise_findings
from estimation.processing import Channels, NoiseModel, PeriodicRecording, PeriodSource
from estimation.processing.hum import HUM, MAINS, HumLine, HumSearch
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import report_progress

_ROUNDING = 1e-12
"""Relative rounding error of a mean over equal numbers."""

_NO_HUM = Assumption(
    "no hum of the mains",
    "the mains hum in the noise",
    "earth and shield the measurement; until then state the spectrum as `noise.force_spectrum` or "
    "`noise.length_spectrum`: a design then keeps the motion's multiples away from it",
    serious=False,
)
_UNITS = {"force": (1.0, "N"), "length": (1e3, "mm")}
_SEEN_ELSEWHERE = (
    "the estimate searches the residuals for it; or state it in `noise.force_spectrum.hum` and "
    "design again: the motion then avoids it"
)
_LEVEL = 0.001
_NOTICEABLE = 0.05
"""Smallest relevant correlation."""
_CLOSE, _FINE, _COARSE = 0.01, 8, 3
"""Smallest eigenvalue of a correlation that is not close to singular; digits if it is, or not."""
_WIDTH = 78


def analyse_noise(recording: PeriodicRecording, source: str = "") -> noise_result.NoiseResult:
    """Analyse the noise of a recording of two periods or more; `source` is its file.

    Raises
    ------
    ValueError
        There is a single period, and therefore no scatter.
    numpy.linalg.LinAlgError
        A force has the noise of others.
    """
    lengths = recording.lengths
    rows = lengths.values if lengths.periods is None else lengths.periods.reshape(-1, ACTUATORS)
    # The resolution of constant channels hides their noise.
    still: Mask = np.ptp(rows, axis=0) <= _ROUNDING * np.max(np.abs(rows), axis=0)
    if np.any(still):
        recording = replace(recording, lengths=_remove_rounding_noise(recording.lengths, still))
    forces, of_lengths = recording.forces.noise(), recording.lengths.noise()
    if forces is None or of_lengths is None:
        raise ValueError(
            f"{recording.periods:.3g} periods show no scatter between periods: an analysis of the "
            "noise needs two or more"
        )
    if forces.is_singular:
        raise np.linalg.LinAlgError("the covariance of the forces is singular")
    noise = NoiseModel(forces, of_lengths)
    # Residuals of a long Fourier series; values if there are separate periods.
    force_rows, length_rows = (
        each.values if each.periods is not None else recording.fit_series(each)[1]
        for each in (recording.forces, recording.lengths)
    )
    report_progress("tests of the noise")
    tests = noise_tests(recording, noise, force_rows, None if np.any(still) else length_rows)
    report_progress("spectrum of the forces", 0, 2)
    force_density, force_hum = noise_result.noise_density(recording.forces, recording.step)
    report_progress("spectrum of the lengths", 1, 2)
    length_density, length_hum = noise_result.noise_density(recording.lengths, recording.step)
    searches = {"force": force_hum, "length": length_hum}
    result = noise_result.NoiseResult(
        **noise_result.covariance_fields(noise),
        recording=source,
        rows=recording.rows,
        periods=float(recording.periods),
        period=float(recording.period),
        averaged=recording.averaged,
        at_rest=recording.source is PeriodSource.REST,
        force_std=np.sqrt(np.diag(forces.covariance)),
        length_std=np.sqrt(np.diag(of_lengths.covariance)),
        whiteness=tests.whiteness,
        normality=tests.normality,
        drift=tests.drift,
        hum=tuple(
            noise_result.HumComponent(quantity, line.frequency, line.amplitudes)
            for quantity, search in searches.items()
            for line in (() if search is None else search.lines)
        ),
        findings=(*noise_findings(tests), hum_finding(searches, tests.whiteness.refused)),
        histogram=noise_result.Histogram.of(tests.samples, tests.normality.forces.std),
        quantiles=noise_result.Quantiles.of(tests.samples),
        force_density=force_density,
        length_density=length_density,
        block=None,
    )
    return replace(result, block=noise_block(result))


def _remove_rounding_noise(channels: Channels, still: Mask) -> Channels:
    """Remove the periods, which cannot be tested, and the rounding noise of constant channels."""
    scatter = channels.scatter
    if scatter is not None:
        moving = ~still
        covariance = scatter.covariance * np.multiply.outer(moving, moving)
        scatter = replace(scatter, covariance=covariance)
    return replace(channels, periods=None, repeats=None, scatter=scatter)


def hum_finding(searches: Mapping[str, HumSearch | None], refused: str = "") -> Finding:
    """Report the searches for a hum in forces and lengths; `refused`: why there was none."""
    done = {kind: search for kind, search in searches.items() if search is not None}
    if not done:
        return _NO_HUM.skip(refused or "the samples are not means of equal numbers of samples")
    hidden = sorted({frequency for search in done.values() for frequency in search.hidden})
    unseen = ""
    if hidden:
        unseen = (
            f"; at {_join_frequencies(hidden)} Hz, a multiple of the motion's frequency, a hum "
            "would be the same in all periods and not visible"
        )
    p = min(1.0, len(done) * min(search.p for search in done.values()))
    found = [_describe_hum(kind, line) for kind, search in done.items() for line in search.lines]
    if not found:
        absent = f"no sinusoid at 50 or 60 Hz and their multiples (p = {p:.2g}){unseen}"
        if set(MAINS) & set(hidden):
            return _NO_HUM.skip(absent, _SEEN_ELSEWHERE)
        return _NO_HUM.holds(absent, p, HUM)
    where = f"{_join_frequencies({line.frequency for s in done.values() for line in s.lines})} Hz"
    return _NO_HUM.fails(f"a hum: {'; '.join(found)}{unseen}", p, HUM, where)


def _describe_hum(kind: str, line: HumLine) -> str:
    factor, unit = _UNITS[kind]
    strut = int(np.argmax(line.amplitudes))
    return (
        f"{line.frequency:.5g} Hz in the {kind}s, up to {factor * line.amplitudes[strut]:.2g} "
        f"{unit} in actuator {strut + 1}"
    )


def _join_frequencies(frequencies: Iterable[float]) -> str:
    return ", ".join(f"{frequency:.4g}" for frequency in sorted(frequencies))


def noise_block(noise: noise_result.NoiseResult) -> str:
    """Return the `noise:` section with units, to paste into a robot or run file.

    It contains significant correlations. A comment names the file of a spectrum, and a comment
    replaces a standard deviation that the recording does not show.
    """
    lines = [
        *_comment(
            f"Noise of one sample of the recording {Path(noise.recording).name}, {noise.rows} "
            f"samples {'at rest' if noise.at_rest else f'in {noise.periods:.4g} periods'}. It "
            "replaces `noise:` in the robot file or the run file.",
            "",
        ),
        *(
            _comment("In motion it may be larger: record any periodic motion to find out.", "")
            if noise.at_rest
            else ()
        ),
        "noise:",
    ]
    for kind, (factor, unit) in _UNITS.items():
        covariance = getattr(noise, f"{kind}_covariance")
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
        lines += _correlation(kind, covariance, getattr(noise, f"{kind}_freedom"))
        lines += _spectrum_comment(noise, kind)
    return "\n".join(lines) + "\n"


def _correlation(kind: str, covariance: Array, freedom: float) -> list[str]:
    correlation = noise_result.correlation_of(covariance)
    upper = np.abs(correlation[np.triu_indices(len(correlation), 1)])
    seen = scipy.stats.norm.isf(_LEVEL / len(upper) / 2) / np.sqrt(freedom)
    if np.max(upper) <= max(seen, _NOTICEABLE):
        return []
    # After rounding, the correlation must remain positive definite.
    digits = _COARSE if np.linalg.eigvalsh(correlation)[0] > _CLOSE else _FINE
    rows = [", ".join(f"{value:.{digits}f}" for value in row) for row in correlation]
    return [f"  {kind}_correlation:", *(f"    - [{row}]" for row in rows)]


def _spectrum_comment(noise: noise_result.NoiseResult, kind: str) -> list[str]:
    test = getattr(noise.whiteness, f"{kind}_noise")
    hum = any(line.quantity == kind for line in noise.hum)
    density = getattr(noise, f"{kind}_density")
    if not len(density.frequency) or not (hum or (test is not None and np.any(test.failed))):
        return []
    why = "hums" if hum else "is not white"
    return _comment(
        f"The noise of the {kind}s {why}. Copy tables/{kind}_spectrum.csv of this folder to the "
        f"folder of the robot file and add {kind}_spectrum: {kind}_spectrum.csv"
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
