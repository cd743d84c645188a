"""Several motions of one run: a run and a folder for each of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from expdesign.configuration.run import RunConfiguration
from expdesign.configuration.schema import LONGEST_NAME


def motion_folders(configuration: RunConfiguration, folder: Path) -> tuple[Path, ...]:
    """Return the run folders of a run's motions; the run's own for a single motion."""
    count = configuration.run.trajectory.count
    if count == 1:
        return (folder,)
    return tuple(folder / f"motion-{number}" for number in range(1, count + 1))


def motion_runs(configuration: RunConfiguration, folder: Path) -> list[RunConfiguration]:
    """Return the runs of the single motions of a run in a folder, each with its share of time.

    The twin's noise differs between them: the first one has the run's seed.
    """
    run, folders = configuration.run, motion_folders(configuration, folder)
    found = []
    for number, own in enumerate(folders):
        suffix = f"-{own.name}"
        each = replace(
            configuration,
            run=run.model_copy(update={"name": run.name[: LONGEST_NAME - len(suffix)] + suffix}),
        )
        for section, changes in (
            ("trajectory", {"count": 1}),
            ("design", {"others": tuple(str(other) for other in folders if other != own)}),
            (
                "experiment",
                {
                    "periods": run.experiment.periods // len(folders),
                    "seed": seed_of(run.experiment.seed, number),
                },
            ),
        ):
            each = each.with_section(section, **changes)
        found.append(each)
    return found


def seed_of(seed: int, number: int) -> int:
    """Return a seed for each number from 0; the first one is the seed itself.

    Examples
    --------
    >>> seed_of(7, 0), seed_of(7, 1) == seed_of(8, 0)
    (7, False)
    """
    return seed if number == 0 else int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
