"""`expdesign certify`: what is proved of a design, of its ways, and of its controller tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from expdesign.cli.export import run_configuration
from expdesign.cli.output import JsonOption, results, say, write_json

if TYPE_CHECKING:
    from expdesign.stages.certification import CertifiedPart


def certify(
    place: Annotated[
        Path,
        typer.Argument(
            metavar="PLACE",
            help="A run folder with run.yaml and design.json, or a controller table.",
            show_default=False,
        ),
    ],
    design: Annotated[
        Path | None,
        typer.Option(
            "--design",
            metavar="DIR",
            help="Of a table: the run folder that it was exported from; that in whose exports/ it "
            "stands by default. A copy without the exports.json beside it is found in DIR's by its "
            "SHA-256.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Prove at every instant that every limit is kept: by a design, its ways and its tables.

    Of each limit the excess is told that no instant has, over how many cells of time it was
    proved, and what stayed open. A controller table is taken as it is read, on the path that its
    controller makes of the rows. Exit status 1 when something is not proved.
    """
    from expdesign.cli.terminal import working
    from expdesign.configuration import InputError
    from expdesign.stages.certification import (
        certified_folder,
        certified_table,
        folder_of_table,
        refuse_part_of_folder,
    )
    from expdesign.stages.folder import refuse_run_file
    from expdesign.stages.outcome import StageFailed
    from expdesign.stages.workspace import Workspace

    path = place.absolute()
    refuse_part_of_folder(path)
    if not path.exists():
        refuse_run_file(place)
        message = "there is no such run folder or table"
        raise InputError(message, path, allowed="expdesign certify DIR | TABLE")
    if path.is_dir() and design is not None:
        message = "the design of a run folder is its own"
        raise InputError(message, key="--design", allowed="a table, or no --design")
    folder = path
    if not path.is_dir():
        folder = folder_of_table(path) if design is None else design.absolute()
    configuration = run_configuration(folder)
    with working("certify") as terminal:
        work = Workspace(configuration, folder, terminal)
        parts = certified_folder(work) if path.is_dir() else [certified_table(work, path)]
    left = [_shortcoming(part) for part in parts if not part.proof.certified]
    data = {"certified": not left, "parts": [part.as_data() for part in parts]}
    if not as_json:
        for part in parts:
            _print(part)
    if left:
        raise StageFailed("; ".join(left), data)
    if as_json:
        write_json({"status": 0, **data})
    else:
        rows = [
            f"{', '.join(part.proof.sampled)} of {part.name}"
            for part in parts
            if part.proof.sampled
        ]
        but = f", but at the rows only: {'; '.join(rows)}" if rows else ""
        say(f"proved: every limit is kept at every instant{but}")


def _shortcoming(part: CertifiedPart) -> str:
    broken = ", ".join(check.key for check in part.proof.broken)
    not_proved = ", ".join(check.key for check in part.proof.open)
    if broken:
        also = f"; not proved: {not_proved}" if not_proved else ""
        return f"{part.name} breaks {broken}{also}"
    return f"{part.name} is not proved to keep {not_proved}"


def _print(part: CertifiedPart) -> None:
    import numpy as np
    from rich import box
    from rich.table import Table

    from expdesign.configuration import quantity_text

    table = Table(title=f"{part.name}: {part.title}", title_justify="left", box=box.SIMPLE_HEAD)
    for head in ("limit", "where", "worst", "bound", "proved", "cells", "open"):
        words = head in ("limit", "where", "proved")
        table.add_column(head, justify="left" if words else "right", no_wrap=True)
    for check in part.proof.limits:
        share = f"{100 * abs(check.proved):.2g} % of the range"
        proved = f"{share} left" if check.proved <= 0 else f"{share} beyond at most"
        if check.key in part.proof.sampled:
            proved = "at the rows only: straight lines have none"
            if check in part.proof.broken:
                proved = f"{100 * check.violation:.2g} % of the range beyond at a row"
        elif not np.isfinite(check.proved):
            proved = "nothing"
        table.add_row(
            check.key,
            check.row,
            quantity_text(check.value, check.unit, 5),
            quantity_text(check.bound, check.unit, 5),
            proved,
            str(check.cells),
            f"{check.open_time:.2g} s" if check.open_time else "",
        )
    results().print(table)
    if np.isfinite(part.proof.unproved_from):
        say(
            f"The struts' lengths determine the pose up to {part.proof.unproved_from:.4f} s only: "
            "nothing is proved of this table."
        )
