"""`expdesign compare`: designs, estimates and Monte-Carlo studies of several run folders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from expdesign.cli.output import JsonOption, note, say, write_json


def compare(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR DIR …", help="Run folders.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder of the comparison.", show_default=False),
    ],
    precision: Annotated[
        str,
        typer.Option(
            "--precision",
            metavar="P",
            help="Relative standard deviation for which the periods are counted.",
        ),
    ] = "5 %",
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Leave out what each limit costs, which takes one solve a design."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare run folders and write report.html, tables and figures into a folder.

    Designs: criteria in common scalings, precision, limits, effort. Estimates: parameters with
    intervals, and whether they differ. Monte-Carlo studies: achieved standard deviations.
    """
    from expdesign.cli.terminal import working
    from expdesign.stages.folder import refuse_unwritable
    from expdesign.stages.outcome import short
    from expdesign.stages.report import reported_stages
    from results.comparison.comparison import write_comparison

    share = precision_share(precision)
    place = out.absolute()
    refuse_unwritable(place)
    paths = [folder.absolute() for folder in folders]
    if not quick and not as_json and any((path / "design.json").is_file() for path in paths):
        note("one solve per design for what each limit costs (--quick leaves it out) …")
    with working("compare"):
        written = write_comparison(
            paths, place, reported_stages(), precision=share, with_sensitivity=not quick
        )
    if as_json:
        write_json(
            {
                "status": 0,
                "folder": str(place),
                "report": str(place / "report.html"),
                "files": [str(path.relative_to(place)) for path in written],
            }
        )
    else:
        say(f"comparison: {short(place / 'report.html')}")


def precision_share(text: str) -> float:
    """Return a relative precision: ``"1 %"`` or ``"0.01"`` → 0.01."""
    from expdesign.configuration import InputError

    number = text.strip().removesuffix("%")
    try:
        share = float(number) / (100 if number != text.strip() else 1)
    except ValueError:
        share = float("nan")
    if not 0 < share <= 1:
        message = f"'{text}' is no relative precision"
        allowed = "above 0 and at most 100 %, e.g. 1% or 0.01"
        raise InputError(message, key="--precision", allowed=allowed)
    return share
