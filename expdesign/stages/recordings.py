"""Recordings of a run: read and refused before the modules of an estimate are loaded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.data.measurement import Measurement
from estimation.data.reading import file_channels, measurement_of, read_measurement
from estimation.data.table import RawTable
from expdesign.configuration import ConfigurationLike, InputError, load_run
from expdesign.configuration.schema import MOST_SAMPLES, require_at_most
from expdesign.progress import track
from expdesign.stages.execution import Place
from expdesign.stages.stage import MEASUREMENT_FILE, Workspace

__all__ = ["Measurement", "load_measurement", "recordings_of"]


def recordings_of(work: Workspace) -> list[Measurement]:
    """Return the recordings of a workspace, each read once; refuse too many samples."""
    found: list[Measurement] = []
    for file in track("reading recordings", work.data_files()):
        if file not in work.recordings:
            work.recordings[file] = _read(work, file)
        found.append(work.recordings[file])
        count = sum(len(recording.time) for recording in found)
        require_at_most(count, MOST_SAMPLES, f"{len(found)} recordings", key="--data")
    return found


def _read(work: Workspace, file: Path) -> Measurement:
    """Return a recording, simulated in this run or read from its file."""
    section, robot = work.configuration.run.data, work.configuration.robot
    simulated = work.made.get("experiment")
    own = work.folder / MEASUREMENT_FILE
    if file != own or simulated is None or simulated.recording is None:
        return read_measurement(file, section, robot)
    # The same table as in the file.
    channels = file_channels(simulated.recording, section, robot).items()
    values = {name: column.astype(np.float64, copy=False) for name, column in channels}
    return measurement_of(RawTable(file, values, {}, "line", 2), section, robot)


def load_measurement(config: ConfigurationLike, file: Place | None = None) -> Measurement:
    """Read a recording by a run's section `data`: columns, units, delay, part of the file.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    file : path, optional
        File in a known format; the run's `data.file` by default.

    Returns
    -------
    Measurement
        Time, lengths and forces, in SI.

    Raises
    ------
    InputError
        The run or the file is unusable; every defect is named with column and row.
    """
    configuration = load_run(config)
    section = configuration.run.data
    place = section.recording if file is None else file
    if place is None:
        raise InputError("no recording is given", configuration.file, key="data.file")
    return read_measurement(place, section, configuration.robot)
