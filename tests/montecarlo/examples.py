"""A small experiment: two harmonics, three periods of 120 samples."""

import pandas as pd

from estimation.montecarlo.result import RepetitionTable
from expdesign.configuration import load_run
from tests.twin.examples import motion

DESIGN = motion(0.5, harmonics=2)


def small(repetitions=4, estimate=None, montecarlo=None, **more):
    """Return a run; keywords are sections and keys of it."""
    return load_run(
        {
            "name": "small",
            "robot": "palida",
            "experiment": {"periods": 3, "sampling": 60},
            "workers": 1,
            "estimate": {"harmonics": 2} | (estimate or {}),
            "montecarlo": {"repetitions": repetitions, "estimators": ["gm", "ml"]}
            | (montecarlo or {}),
        }
        | more
    )


def repetition_rows(study):
    """Return the rows of `tables/montecarlo_repetitions.csv`."""
    table = RepetitionTable("", "", tuple(study.truth))
    return pd.DataFrame(table.rows(study.repetitions), columns=list(table.names))


class Watcher:
    """A monitor that remembers, and asks to stop when so many are done."""

    def __init__(self, stop_at=None):
        self.seen = []
        self.stop_at = stop_at

    def advanced(self, done, total):
        self.seen.append((done, total))

    def stop_requested(self):
        return self.stop_at is not None and self.seen[-1][0] >= self.stop_at
