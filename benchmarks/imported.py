"""Machines of other programs: imported as `expdesign init --from` does, and designed for.

What their files do not say stays as `init` assumes it; limits, home and joints are the machines'.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

import expdesign
from expdesign.configuration.document import read_yaml
from expdesign.machines.importing import read_machine
from expdesign.machines.writing import write_files
from tests.machines.simulated import mjcf

TITLE = "Machines from other programs' files"

_LINUXCNC = Path(
    "/usr/share/doc/linuxcnc/examples/sample-configs/sim/axis/vismach/hexapod-sim/hexapod.ini"
)
_PI = Path(__file__).parents[1] / "tests/machines/machines/h811.yaml"
_SEARCH = {"starts": 2, "search": "restarts", "seed": 0}


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each machine, with the design that is found for it."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        model = folder / "model.xml"
        model.write_text(mjcf(), encoding="utf-8")
        for machine, file, source in (
            ("h811", _PI, "PI, YAML of H-811.I2"),
            ("hexapod", _LINUXCNC, "LinuxCNC's hexapod configuration (Debian's package)"),
            ("model", model, "a hexapod in MJCF, written for the tests"),
        ):
            if file.is_file():
                yield {"machine": source, **_designed(machine, file, folder)}


def _designed(name: str, file: Path, folder: Path) -> dict[str, Any]:
    written = write_files(read_machine(name, [file]), folder)
    run = read_yaml(written.run).data
    run["robot"] = str(written.robot)
    run["design"] |= _SEARCH
    run["workers"] = 1
    began = time.perf_counter()
    result = expdesign.design(run)
    return {
        "log det F": round(result.log_det_information, 2),
        "status": result.status,
        "every limit kept": result.passed,
        "above a limit at most, share of its range": f"{max(result.check.worst, 0.0):.1e}",
        "s": round(time.perf_counter() - began),
    }


def summary(table: pd.DataFrame) -> str:
    """Return for how many a design was found that keeps every limit."""
    return f"{int(table['every limit kept'].sum())} of {len(table)} designs keep every limit"
