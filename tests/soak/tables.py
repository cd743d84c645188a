"""Tables made wrong at random: nothing that is wrong is called proved."""

from pathlib import Path
from tempfile import TemporaryDirectory

from tests.export.wrong_tables import Exported, missed_tables, refused_tables

TITLE = "controller tables with random faults, and with harmless changes"
ACCEPTED = 0.95


def add_options(parser):
    parser.add_argument("--count", type=int, default=400, help="tables with a fault")
    parser.add_argument("--seed", type=int, default=39)


def run(arguments):
    count, seed = arguments.count, arguments.seed
    with TemporaryDirectory() as folder:
        exported = Exported(Path(folder))
        missed, wrong, proved = missed_tables(exported, count, seed)
        print(
            f"{count} tables: {wrong} wrong, {proved} proved, {len(missed)} of them wrong", missed
        )
        refused = refused_tables(exported, count // 4, seed)
        print(f"{count // 4} with harmless changes: {len(refused)} not proved", refused)
    return not missed and len(refused) <= (1 - ACCEPTED) * (count // 4)
