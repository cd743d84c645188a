"""Command `export`: one controller table, those that the run names, or the list of formats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.table import Table

from expdesign.cli.options import EXPORT_OPTIONS, flag
from expdesign.cli.output import note, results, write_json
from expdesign.cli.runs import execute_stage, run_configuration, warn_of_changes
from expdesign.cli.terminal import working
from expdesign.configuration import ExportSection, InputError, RunConfiguration
from expdesign.configuration.document import document_from_mapping
from expdesign.configuration.export import SCALES, STRUT_ONLY, export_formats
from expdesign.configuration.schema import validate
from expdesign.export.formats import table_formats
from expdesign.export.result import FOLDER
from expdesign.runfolder.lock import one_writer_to
from expdesign.stages.execution import refuse_unwritable
from expdesign.stages.export import export_one, export_path, export_task
from expdesign.stages.registry import stages
from expdesign.stages.stage import StageFailed, Workspace, short
from results.render.terminal import print_view

_LIST = "list"


def export_motion(
    folder: Path | None,
    name: str,
    out: Path | None,
    options: Mapping[str, str | None],
    *,
    as_json: bool,
) -> None:
    """Export one table, every table that the run names, or the list of formats."""
    if name == _LIST or (not name and folder == Path(_LIST) and not folder.exists()):
        _list(as_json=as_json)
        return
    if folder is None:
        raise InputError("no run folder is given", allowed="expdesign export DIR")
    folder = folder.resolve()
    configuration = run_configuration(folder)
    if not name:
        alone = out is None and all(text is None for text in options.values())
        if configuration.run.export and alone:
            execute_stage("export", str(configuration.file), folder, as_json)
            return
        allowed = " | ".join((*table_formats(), _LIST))
        raise InputError("no format is given", key="--format", allowed=allowed)
    given = {
        key: EXPORT_OPTIONS[key].read(text) for key, text in options.items() if text is not None
    }
    place = folder / FOLDER
    target = place / name if out is None else out.absolute()
    refuse_unwritable(target.parent)
    parent = target.parent.resolve()
    target = (place if parent == place.resolve() else parent) / target.name
    with (
        working("export") as terminal,
        one_writer_to(target.parent, "expdesign export", folder, target.name) as reading,
    ):
        with reading:
            warn_of_changes(folder, "", "design", "export")
            work = Workspace(run_configuration(folder), folder, terminal)
            work.warn(work.configuration.warnings_before("export"))
            section = _section(name, given, work.configuration)
            path = export_path(section, work, None if out is None else target)
            task = export_task(work)
        outcome = export_one(stages()["export"], section, work, task, path)
    if not as_json and outcome.view is not None:
        table, *others = outcome.files
        also = f", with {', '.join(path.name for path in others)}" if others else ""
        print_view(outcome.view, results(), f"{short(table)}{also}")
    if outcome.failure:
        raise StageFailed(outcome.failure, outcome.summary)
    if as_json:
        write_json({"status": 0, **outcome.summary})


def _list(*, as_json: bool) -> None:
    found = [
        {
            "name": name,
            "title": form.title,
            "suffix": form.suffix,
            "interpolation": form.interpolation.value,
            "spaces": form.options.spaces,
            "options": form.options.own_options(),
        }
        for name, form in table_formats().items()
    ]
    if as_json:
        write_json(found)
        return
    table = Table()
    for heading in ("format", "for", "coordinates", "options other than segment, scale, tolerance"):
        table.add_column(heading, overflow="fold", no_wrap=heading == "format")
    for name, form in table_formats().items():
        spaces, options = form.options.spaces, form.options.own_options()
        table.add_row(name, form.title, ", ".join(spaces), ", ".join(options))
    results().print(table)


def _section(name: str, given: dict[str, Any], configuration: RunConfiguration) -> ExportSection:
    """Return the options of the run for the format, overridden by the given ones.

    Options of the run that contradict the given ones are left out, with a note.
    """
    stated = _stated_table(name, given.get("file"), configuration)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    left_out = {} if stated is None else _contradicted_options(given, stated)
    for key in left_out:
        del data[key]
    data |= {"format": name, **given}
    options = export_formats().get(name, ExportSection)
    try:
        found = validate(options, data, document_from_mapping(data))
    except InputError as error:
        raise InputError(replace(one, key=flag(one.key)) for one in error.problems) from None
    for option in dict.fromkeys(left_out.values()):
        keys = ", ".join(key for key, given_option in left_out.items() if given_option == option)
        note(f"left out, since {option} is given: {keys} of the run's export")
    return found


def _stated_table(
    name: str, file: str | None, configuration: RunConfiguration
) -> ExportSection | None:
    """Return the run's table of a format; of several the one with this file."""
    named = [entry for entry in configuration.run.export if entry.format == name]
    if len(named) > 1:
        named = [
            entry for entry in named if file in {entry.stem, entry.stem + entry.suffix}
        ] or named
    if len(named) > 1:
        stems = [entry.stem for entry in named]
        raise InputError(
            f"the run has {len(named)} tables of {name}, each with other options"
            + ("" if file is None else f", and none of them is '{file}'"),
            file=configuration.file,
            key="--file",
            allowed=" | ".join(stems),
        )
    return named[0] if named else None


def _contradicted_options(given: dict[str, Any], stated: ExportSection) -> dict[str, str]:
    """Return options of the run that contradict given ones, each with the given option."""
    space = given.get("space", stated.coordinates)
    # Axes of the run are those of its coordinates.
    of_space = ("axes", *(STRUT_ONLY if space == "pose" else ()))
    against = {
        **{key: tuple(other for other in SCALES if other != key) for key in SCALES},
        "space": of_space if space != stated.coordinates else (),
        "encoding": ("digits",) if given.get("encoding") == "mcap" else (),
    }
    gone: dict[str, str] = {}
    for option, keys in against.items():
        for key in keys:
            if option in given and getattr(stated, key) is not None:
                gone.setdefault(key, flag(option))
    return gone
