"""`expdesign export`: controller tables of the designed motion, each checked by reading it back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.export_options import export_section, given_options
from expdesign.cli.output import JsonOption, results, write_json

if TYPE_CHECKING:
    from expdesign.configuration import Problem, RunConfiguration

_LIST = "list"

FolderArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="DIR", help="A run folder with run.yaml and design.json.", show_default=False
    ),
]
FormatOption = Annotated[
    str, typer.Option("--format", metavar="NAME", help="Format; `list` names them.")
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File to write; in DIR/exports by default."),
]


def _text_option(name: str, metavar: str, text: str) -> Any:
    return typer.Option(f"--{name}", metavar=metavar, help=text)


def export(  # noqa: PLR0917 - each is an option of the command
    folder: FolderArgument = None,
    name: FormatOption = "",
    out: OutOption = None,
    file: Annotated[
        str | None,
        _text_option("file", "NAME", "Name in DIR/exports; of several tables of the run, which."),
    ] = None,
    space: Annotated[
        str | None, _text_option("space", "strut|pose", "Coordinates of the table.")
    ] = None,
    segment: Annotated[
        str | None,
        _text_option("segment", "TIME", "Between two rows, such as '10 ms'; the longest for PVT."),
    ] = None,
    digits: Annotated[
        str | None, _text_option("digits", "N", "Digits after the decimal point.")
    ] = None,
    units: Annotated[str | None, _text_option("units", "m|mm|um|in", "Unit of lengths.")] = None,
    angles: Annotated[str | None, _text_option("angles", "rad|deg", "Unit of angles.")] = None,
    axes: Annotated[
        str | None, _text_option("axes", "A,B,…", "Six names, in the controller's order.")
    ] = None,
    order: Annotated[
        str | None, _text_option("order", "1,2,…", "Number of the strut on each axis.")
    ] = None,
    sign: Annotated[
        str | None, _text_option("sign", "1,-1,…", "Of struts 1 to 6; one for all or six.")
    ] = None,
    offset: Annotated[
        str | None,
        _text_option("offset", "L,…", "Strut length at which its axis reads zero, or `home`."),
    ] = None,
    counts_per_metre: Annotated[
        str | None, _text_option("counts-per-metre", "C,…", "Motor counts; one for all or six.")
    ] = None,
    tolerance: Annotated[
        str | None, _text_option("tolerance", "L", "Largest deviation of a strut, such as '1 um'.")
    ] = None,
    blend: Annotated[str | None, _text_option("blend", "L", "P of G64 for LinuxCNC.")] = None,
    encoding: Annotated[str | None, _text_option("encoding", "yaml|mcap", "Of ros2.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the designed motion, with its ways from and to rest, as a table for a controller.

    Options that are not given are those of the run's `export:`, then the format's own. Every file
    is read back, executed as its controller would, and held against design and limits; a file
    that fails is not kept (exit status 1).
    """
    from expdesign.cli import shown
    from expdesign.cli.terminal import Terminal
    from expdesign.configuration import InputError, Problem
    from expdesign.stages.export import export_one
    from expdesign.stages.progress import short
    from expdesign.stages.workspace import Workspace

    if name == _LIST or (not name and folder == Path(_LIST) and not folder.exists()):
        _list(as_json=as_json)
        return
    if folder is None:
        raise InputError(Problem("no run folder is given", allowed="expdesign export DIR"))
    given = given_options(
        file=file,
        space=space,
        segment=segment,
        units=units,
        angles=angles,
        tolerance=tolerance,
        blend=blend,
        encoding=encoding,
        digits=digits,
        axes=axes,
        offset=offset,
        order=order,
        sign=sign,
        counts_per_metre=counts_per_metre,
    )
    folder = folder.absolute()
    configuration = _configuration(folder)
    if not name:
        raise InputError(_missing_format())
    section = export_section(name, given, configuration)
    outcome = export_one(section, Workspace(configuration, folder, Terminal()), out)
    if as_json:
        write_json({"status": 0, **outcome.summary})
    else:
        shown.tables(outcome)
        results().print(f"written to {short(outcome.files[0])}")


def _list(*, as_json: bool) -> None:
    from rich.table import Table

    from expdesign.configuration import OFFERS
    from expdesign.export import table_formats

    formats = table_formats()
    if as_json:
        write_json(
            [
                {
                    "name": form.name,
                    "title": form.title,
                    "suffix": form.suffix,
                    "interpolation": form.interpolation.value,
                    "spaces": OFFERS[form.name].spaces,
                    "options": OFFERS[form.name].options,
                }
                for form in formats.values()
            ]
        )
        return
    table = Table()
    for heading in ("format", "for", "coordinates", "options beside segment and tolerance"):
        table.add_column(heading, overflow="fold", no_wrap=heading == "format")
    for form in formats.values():
        offer = OFFERS[form.name]
        table.add_row(form.name, form.title, ", ".join(offer.spaces), ", ".join(offer.options))
    results().print(table)


def _missing_format() -> Problem:
    from expdesign.configuration import Problem
    from expdesign.export import table_formats

    return Problem(
        "no format is given", key="--format", allowed=" | ".join((*table_formats(), _LIST))
    )


def _configuration(folder: Path) -> RunConfiguration:
    from expdesign.configuration import InputError, Problem, load_run

    file = folder / "run.yaml"
    if not file.is_file():
        raise InputError(
            Problem(
                "this is no run folder: it has no run.yaml",
                file=folder,
                key="DIR",
                allowed="a folder that `expdesign design` or `expdesign run` wrote",
            )
        )
    return load_run(file)
