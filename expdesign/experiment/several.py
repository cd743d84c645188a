"""The designs of a sweep: a run folder each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from expdesign.configuration import RunConfiguration
from expdesign.experiment.design import design
from expdesign.experiment.result import DesignResult
from expdesign.workers import Monitor

FOLDER = "designs"
"""Of their run folders, in that of the run."""


def design_folder(folder: Path, name: str) -> Path:
    """Return the run folder of one of the designs of the run in `folder`."""
    return folder / FOLDER / name


def designed(configuration: RunConfiguration, monitor: Monitor) -> DesignResult:
    """Make one of the designs with the errors of `design`: in this process alone, or on a cluster.

    Where the run states a scheduler the search of every design has the whole cluster.
    """
    if configuration.run.scheduler is None:
        alone = configuration.run.model_copy(update={"workers": 1})
        configuration = replace(configuration, run=alone)
    return design(configuration, monitor)
