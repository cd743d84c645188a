"""The noise of a recording by itself, without model or parameters (the paper's Figs. 4, 5).

Everything comes from contrasts between the periods.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints.arrays import Mask
from estimation.diagnostics.findings import noise_findings
from estimation.diagnostics.hum_finding import hum_finding
from estimation.diagnostics.noise_block import noise_block
from estimation.diagnostics.noise_density import noise_density
from estimation.diagnostics.noise_record import HumKeys, NoiseFile, NoiseRecord, noise_keys
from estimation.diagnostics.noise_tests import noise_tests
from estimation.processing import Channels, NoiseModel, PeriodSource, Record
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import report_progress
from expdesign.runfolder import copied

_ROUNDING = 1e-12
"""Of a mean over equal numbers, as a share of them."""


def analyse_noise(record: Record, source: str = "") -> NoiseRecord:
    """Analyse the noise of a recording of two periods or more; `source` is its file.

    Raises
    ------
    ValueError
        Fewer periods show no scatter.
    """
    still = _still(record.lengths)
    if np.any(still):
        record = replace(record, lengths=_resolution_only(record.lengths, still))
    forces, lengths = record.forces.noise(), record.lengths.noise()
    if forces is None or lengths is None:
        raise ValueError(
            f"{record.periods:.3g} periods show no scatter between periods: the noise of a "
            "recording takes two periods or more"
        )
    noise = NoiseModel(forces, lengths)
    # What a long Fourier series leaves; the periods serve where there are any.
    force_rows, length_rows = (
        each.values if each.periods is not None else record.about_series(each)[1]
        for each in (record.forces, record.lengths)
    )
    report_progress("tests of the noise")
    tests = noise_tests(record, noise, force_rows, None if np.any(still) else length_rows)
    report_progress("spectrum of the forces", 0, 2)
    force_density, force_hum = noise_density(record.forces, record.step)
    report_progress("spectrum of the lengths", 1, 2)
    length_density, length_hum = noise_density(record.lengths, record.step)
    searches = {"force": force_hum, "length": length_hum}
    summary = copied(
        NoiseFile,
        tests,
        **noise_keys(noise),
        recording=source,
        rows=record.rows,
        periods=float(record.periods),
        period=float(record.period),
        averaged=record.averaged,
        at_rest=record.source is PeriodSource.REST,
        force_std=np.sqrt(np.diag(forces.covariance)),
        length_std=np.sqrt(np.diag(lengths.covariance)),
        hum=tuple(
            HumKeys(quantity, line.frequency, line.amplitudes)
            for quantity, search in searches.items()
            for line in (() if search is None else search.lines)
        ),
        findings=(*noise_findings(tests), hum_finding(searches, tests.whiteness.refused)),
    )
    return NoiseRecord(
        summary=summary,
        block=noise_block(summary, {"force": force_density, "length": length_density}),
        force_density=force_density,
        length_density=length_density,
        **NoiseRecord.parts(noise, tests),
    )


def _still(channels: Channels) -> Mask:
    """Return which channels do not change at all, (6,): their resolution hides the noise."""
    rows = channels.values if channels.periods is None else channels.periods.reshape(-1, ACTUATORS)
    extent: Mask = np.ptp(rows, axis=0) <= _ROUNDING * np.max(np.abs(rows), axis=0)
    return extent


def _resolution_only(channels: Channels, still: Mask) -> Channels:
    """Return them without periods, of which nothing could be tested, and without rounding noise."""
    scatter = channels.scatter
    if scatter is not None:
        moving = ~still
        covariance = scatter.covariance * np.multiply.outer(moving, moving)
        scatter = replace(scatter, covariance=covariance)
    return replace(channels, periods=None, repeats=None, scatter=scatter)
