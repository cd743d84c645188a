"""`expdesign export`: controller tables of the designed motion, each checked by reading it back."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.options import Option, flag, with_options
from expdesign.cli.output import JsonOption, note, results, say, write_json

if TYPE_CHECKING:
    from expdesign.configuration import ExportSection, RunConfiguration

_LIST = "list"


def _whole(text: str) -> int | str:
    """Return a whole number; text that is none is left to the schema, which refuses it."""
    try:
        return int(text)
    except ValueError:
        return text


def _items(text: str, read: Callable[[str], Any] = str) -> Any:
    """Return one item, or a list of several."""
    items = [read(item.strip()) for item in text.split(",")]
    return items[0] if len(items) == 1 else items


_wholes = partial(_items, read=_whole)


_OPTIONS = {
    "file": Option("NAME", "Name in DIR/exports; of several tables of the run, which."),
    "space": Option("strut|pose", "Coordinates of the table."),
    "segment": Option("TIME", "Between two rows, such as '10 ms'; the longest for PVT."),
    "scale": Option("F", "Smaller and slower, for a first run: home + F (λ(F t) − home)."),
    "digits": Option("N", "Digits after the decimal point.", _whole),
    "units": Option("m|mm|um|in", "Unit of lengths."),
    "angles": Option("rad|deg", "Unit of angles."),
    "axes": Option("A,B,…", "Six names, in the controller's order.", _items),
    "order": Option("1,2,…", "Number of the strut on each axis.", _wholes),
    "sign": Option("1,-1,…", "Of struts 1 to 6; one for all or six.", _wholes),
    "offset": Option("L,…", "Strut length at which its axis reads zero, or `home`.", _items),
    "counts_per_metre": Option("C,…", "Motor counts; one for all or six.", _items),
    "tolerance": Option("L", "Largest deviation of a strut, such as '1 um'."),
    "blend": Option("L", "P of G64 for LinuxCNC."),
    "encoding": Option("yaml|mcap", "Of ros2."),
    "trigger": Option("N", "Digital output that is on in the measurement window.", _whole),
}
"""By key of `export:`."""


@with_options(_OPTIONS)
def export(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="DIR", help="A run folder with run.yaml and design.json.", show_default=False
        ),
    ] = None,
    name: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help="Format; `list` names them. Without: every table that the run names.",
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write; in DIR/exports by default."),
    ] = None,
    as_json: JsonOption = False,
    **options: str | None,
) -> None:
    """Write the designed motion, with its ways from and to rest, as tables for a controller.

    Without --format these are the tables of the run's `export:`. With it, other options that are
    not given are those of the run's `export:` for this format, then the format's own. Every file
    is read back, executed as its controller would, and held against design and limits; a file that
    fails is not kept (exit status 1).
    """
    from expdesign.cli import shown
    from expdesign.cli.commands import do_one
    from expdesign.cli.terminal import working
    from expdesign.configuration import InputError
    from expdesign.export.formats import table_formats
    from expdesign.stages.export import export_one
    from expdesign.stages.outcome import short
    from expdesign.stages.workspace import Workspace

    if name == _LIST or (not name and folder == Path(_LIST) and not folder.exists()):
        _list(as_json=as_json)
        return
    if folder is None:
        raise InputError("no run folder is given", allowed="expdesign export DIR")
    folder = folder.absolute()
    configuration = run_configuration(folder)
    if not name:
        alone = out is None and all(text is None for text in options.values())
        if configuration.run.export and alone:
            do_one("export", str(configuration.file), folder, as_json)
            return
        allowed = " | ".join((*table_formats(), _LIST))
        raise InputError("no format is given", key="--format", allowed=allowed)
    given = {key: _OPTIONS[key].read(text) for key, text in options.items() if text is not None}
    section = _section(name, given, configuration)
    with working("export") as terminal:
        outcome = export_one(section, Workspace(configuration, folder, terminal), out)
    if as_json:
        write_json({"status": 0, **outcome.summary})
    else:
        shown.tables(outcome)
        table, *beside = outcome.files
        with_it = f", with {', '.join(path.name for path in beside)} beside it" if beside else ""
        say(f"written to {short(table)}{with_it}")


def _list(*, as_json: bool) -> None:
    from rich.table import Table

    from expdesign.configuration.sections.export import OFFERS, Offer
    from expdesign.export.formats import table_formats

    found = [
        {
            "name": name,
            "title": form.title,
            "suffix": form.suffix,
            "interpolation": form.interpolation.value,
            **OFFERS[name]._asdict(),
        }
        for name, form in table_formats().items()
    ]
    if as_json:
        write_json(found)
        return
    table = Table()
    for heading in ("format", "for", "coordinates", "options beside segment, scale, tolerance"):
        table.add_column(heading, overflow="fold", no_wrap=heading == "format")
    for one in found:
        lists = (", ".join(one[key]) for key in Offer._fields)
        table.add_row(one["name"], one["title"], *lists)
    results().print(table)


def run_configuration(folder: Path) -> RunConfiguration:
    """Return the configuration of a run folder."""
    from expdesign.configuration import InputError, load_run

    file = folder / "run.yaml"
    if not file.is_file():
        message = "this is no run folder: it has no run.yaml"
        allowed = "a folder that `expdesign design` or `expdesign run` wrote"
        raise InputError(message, folder, key="DIR", allowed=allowed)
    return load_run(file)


def _section(name: str, given: dict[str, Any], configuration: RunConfiguration) -> ExportSection:
    """Return what is asked for: the run's own options for the format, overridden by these.

    Options of the run that do not go with what is given are left out, and named.
    """
    from dataclasses import replace

    from expdesign.configuration import ExportSection, InputError
    from expdesign.configuration.document import document_from_mapping
    from expdesign.configuration.section import validate

    stated = _stated(name, given.get("file"), configuration)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    left_out = {} if stated is None else _left_out(given, stated)
    for key in left_out:
        del data[key]
    data |= {"format": name, **given}
    found, problems = validate(ExportSection, data, document_from_mapping(data))
    if found is None:
        raise InputError(replace(problem, key=flag(problem.key)) for problem in problems)
    for option in dict.fromkeys(left_out.values()):
        keys = ", ".join(key for key, given_option in left_out.items() if given_option == option)
        note(f"left out, since {option} is given: {keys} of the run's export")
    return found


def _stated(name: str, file: str | None, configuration: RunConfiguration) -> ExportSection | None:
    """Return the table of this format that the run names; of several the one with this file."""
    from expdesign.configuration import InputError

    named = [entry for entry in configuration.run.export if entry.format == name]
    if len(named) > 1:
        named = [entry for entry in named if entry.stem == file] or named
    if len(named) > 1:
        stems = [entry.stem for entry in named]
        raise InputError(
            f"the run has {len(named)} tables of {name}, each with options of its own"
            + ("" if file is None else f", and none of them is '{file}'"),
            file=configuration.file,
            key="--file",
            allowed=" | ".join(stems),
        )
    return named[0] if named else None


def _left_out(given: dict[str, Any], stated: ExportSection) -> dict[str, str]:
    """Return which options of the run do not go with those given, each with the option given."""
    from expdesign.configuration.sections.export import STRUT_ONLY

    space = given.get("space", stated.coordinates)
    # Axes of the run are those of its coordinates.
    of_space = ("axes", *(STRUT_ONLY if space == "pose" else ()))
    against = {
        "counts_per_metre": ("units",),
        "units": ("counts_per_metre",),
        "space": of_space if space != stated.coordinates else (),
        "encoding": ("digits",) if given.get("encoding") == "mcap" else (),
    }
    gone: dict[str, str] = {}
    for option, keys in against.items():
        for key in keys:
            if option in given and getattr(stated, key) is not None:
                gone.setdefault(key, flag(option))
    return gone
