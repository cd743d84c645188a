"""What the search for a hum in the noise of a recording found, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from estimation.diagnostics.finding import Assumption, Finding
from estimation.processing.hum import HUM, MAINS, HumLine, HumSearch

_NO_HUM = Assumption(
    "no hum of the mains",
    "the mains hum in the noise",
    "earth and shield the measurement; until then hand the spectrum on to `noise.force_spectrum` "
    "or `noise.length_spectrum`: a design then keeps its multiples away from it",
    serious=False,
)
_UNITS = {"force": (1.0, "N"), "length": (1e3, "mm")}


_SEEN_ELSEWHERE = (
    "the estimate looks for it in what the model leaves; or state it in "
    "`noise.force_spectrum.hum` and design again: the motion then keeps away from it"
)


def hum_finding(searches: Mapping[str, HumSearch | None], refused: str = "") -> Finding:
    """Say what was found.

    Parameters
    ----------
    searches : mapping of str to HumSearch
        Those in the forces and lengths, where there were any.
    refused : str
        Why there was none.
    """
    done = {kind: search for kind, search in searches.items() if search is not None}
    if not done:
        return _NO_HUM.untested(refused or "the samples are no means of equally many")
    hidden = sorted({frequency for search in done.values() for frequency in search.hidden})
    unseen = ""
    if hidden:
        unseen = (
            f"; at {_listed(hidden)} Hz, a multiple of the motion's frequency, none can be seen "
            "between periods"
        )
    p = min(1.0, len(done) * min(search.p for search in done.values()))
    found = [_words(kind, line) for kind, search in done.items() for line in search.lines]
    if not found:
        absent = f"no sinusoid at 50 or 60 Hz and their multiples (p = {p:.2g}){unseen}"
        if set(MAINS) & set(hidden):
            return _NO_HUM.untested(absent, _SEEN_ELSEWHERE)
        return _NO_HUM.holds(absent, p, HUM)
    where = f"{_listed({line.frequency for s in done.values() for line in s.lines})} Hz"
    return _NO_HUM.fails(f"a hum: {'; '.join(found)}{unseen}", p, HUM, where)


def _words(kind: str, line: HumLine) -> str:
    factor, unit = _UNITS[kind]
    strut = int(np.argmax(line.amplitudes))
    return (
        f"{line.frequency:.5g} Hz in the {kind}s, up to {factor * line.amplitudes[strut]:.2g} "
        f"{unit} in actuator {strut + 1}"
    )


def _listed(frequencies: Iterable[float]) -> str:
    return ", ".join(f"{frequency:.4g}" for frequency in sorted(frequencies))
