"""Repeat three studies of the paper on the digital twin, for PaLiDA or any other hexapod.

``python examples/paper/run.py [--robot NAME | FILE] [--out DIR] [--quick] [--workers N]``
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from examples.paper.designs import study_designs
from examples.paper.identification import study_identification
from examples.paper.report import summary, write_report
from examples.paper.setting import PAPER_ROBOT, Setting, StudyResult
from examples.paper.validation import study_validation
from expdesign import design


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the three studies and write the report. A claim that fails is a result, not an error."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--robot", default=PAPER_ROBOT, help="a robot file, or one that ships")
    parser.add_argument("--out", type=Path, default=Path("runs/paper"), metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="small: to see the steps, in a minute")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes")
    given = parser.parse_args(arguments)
    file = Path(given.robot)
    robot = str(file.resolve()) if file.is_file() else given.robot
    setting = Setting(robot, quick=given.quick, workers=given.workers)
    results: list[StudyResult] = []
    for result in _studies(setting, given.out):
        results.append(result)
        # What is done stays, whatever happens to the studies that follow.
        page = write_report(setting, results, given.out)
    print(f"{summary(results)}; written to {page}")


def _studies(setting: Setting, out: Path) -> Iterator[StudyResult]:
    yield study_designs(setting, out)
    motion = design(setting.configuration()).trajectory
    yield study_identification(setting, motion)
    yield study_validation(setting, motion)


if __name__ == "__main__":
    main()
