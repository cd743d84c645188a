"""Commands on the motion and the model for a controller: export, certify, model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError
from rich.table import Table

from expdesign.cli.options import EXPORT_OPTIONS, flag
from expdesign.cli.output import note, results, say, write_json
from expdesign.cli.runs import execute_stage, run_configuration
from expdesign.cli.terminal import working
from expdesign.configuration import ExportSection, InputError, RunConfiguration, quantity_text
from expdesign.configuration.document import document_from_mapping
from expdesign.configuration.export import STRUT_ONLY, export_formats
from expdesign.configuration.quantity import SPEED
from expdesign.configuration.schema import validate
from expdesign.export.certification import PROVED
from expdesign.export.formats import table_formats
from expdesign.recheck.limit_check import LimitCheck
from expdesign.stages.certification import (
    CertifiedPart,
    certified_folder,
    certified_table,
    folder_of_table,
    refuse_part_of_folder,
    worst_verdict,
)
from expdesign.stages.exporting import export_one
from expdesign.stages.folder import refuse_run_file
from expdesign.stages.model import export_model
from expdesign.stages.registry import stages
from expdesign.stages.workspace import StageFailed, Workspace, short
from results.render.terminal import print_table, print_view
from results.views.export import control_models_view
from results.views.view import ReportTable, TableColumn

_LIST = "list"


def export(
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
    folder = folder.absolute()
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
    section = _section(name, given, configuration)
    with working("export") as terminal:
        outcome = export_one(
            stages()["export"], section, Workspace(configuration, folder, terminal), out
        )
    if as_json:
        write_json({"status": 0, **outcome.summary})
    else:
        table, *others = outcome.files
        also = f", with {', '.join(path.name for path in others)}" if others else ""
        if outcome.view is not None:
            print_view(outcome.view, results(), f"{short(table)}{also}")


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
    stated = _stated(name, given.get("file"), configuration)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    left_out = {} if stated is None else _left_out(given, stated)
    for key in left_out:
        del data[key]
    data |= {"format": name, **given}
    found, problems = validate(
        export_formats().get(name, ExportSection), data, document_from_mapping(data)
    )
    if found is None:
        raise InputError(replace(problem, key=flag(problem.key)) for problem in problems)
    for option in dict.fromkeys(left_out.values()):
        keys = ", ".join(key for key, given_option in left_out.items() if given_option == option)
        note(f"left out, since {option} is given: {keys} of the run's export")
    return found


def _stated(name: str, file: str | None, configuration: RunConfiguration) -> ExportSection | None:
    """Return the run's table of a format; of several the one with this file."""
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
    """Return options of the run that contradict given ones, each with the given option."""
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


def certify(place: Path, design: Path | None, *, piece: bool, as_json: bool) -> None:
    """Certify the motions of a run folder, or one controller table or a piece of one."""
    path = place.absolute()
    refuse_part_of_folder(path)
    if not path.exists():
        refuse_run_file(place)
        message = "there is no such run folder or table"
        raise InputError(message, path, allowed="expdesign certify DIR | TABLE")
    if path.is_dir() and (design is not None or piece):
        key = "--part" if design is None else "--design"
        message = "a run folder has its design and whole tables"
        raise InputError(message, key=key, allowed=f"a table, or no {key}")
    folder = path
    if not path.is_dir():
        folder = folder_of_table(path) if design is None else design.absolute()
    configuration = run_configuration(folder)
    with working("certify") as terminal:
        work = Workspace(configuration, folder, terminal)
        if path.is_dir():
            parts = certified_folder(work)
        else:
            parts = [certified_table(work, path, piece=piece)]
    verdict = worst_verdict(parts)
    data = {
        "certified": verdict == PROVED,
        "verdict": verdict,
        "parts": [part.as_data() for part in parts],
    }
    if not as_json:
        _print_certificates(parts)
    if verdict != PROVED:
        left = "; ".join(_shortcoming(part) for part in parts if not part.proof.certified)
        raise StageFailed(f"{verdict}: {left}", data)
    if as_json:
        write_json({"status": 0, **data})
    else:
        rows = [
            f"{', '.join(part.proof.sampled)} of {part.name}"
            for part in parts
            if part.proof.sampled
        ]
        but = f", but at the rows only: {'; '.join(rows)}" if rows else ""
        say(f"proved: every limit is kept at every instant{' of the piece' if piece else ''}{but}")


def _print_certificates(parts: list[CertifiedPart]) -> None:
    for part in parts:
        if part.proof.limits:
            print_table(results(), _certificate_table(part))
        if np.isfinite(part.proof.unproved_from):
            say(
                f"The strut lengths determine the pose up to {part.proof.unproved_from:.4f} s "
                "only: nothing is proved for this table."
            )
        for remark in part.proof.remarks:
            say(f"{part.name}: {remark}")


def _shortcoming(part: CertifiedPart) -> str:
    """Return what is wrong with a part, or not proved of it, in words."""
    proof = part.proof
    broken = ", ".join(check.key for check in proof.broken)
    not_proved = ", ".join(check.key for check in proof.open)
    found = [f"breaks {broken}"] if broken else []
    found += proof.faults
    found += [f"not proved: {not_proved}"] if not_proved else []
    return f"{part.name}: {'; '.join([*found, *proof.unchecked])}"


def _certificate_table(part: CertifiedPart) -> ReportTable:
    def proof(check: LimitCheck) -> str:
        share = f"{100 * abs(check.proved):.2g} % of the range"
        if check.key in part.proof.sampled:
            if check in part.proof.broken:
                return f"{100 * check.violation:.2g} % of the range beyond at a row"
            return "at the rows only: straight lines have none"
        if not np.isfinite(check.proved):
            return "nothing"
        return f"{share} left" if check.proved <= 0 else f"{share} beyond at most"

    columns = (
        TableColumn("limit", kind="text", of="key"),
        TableColumn("where", kind="text", of="row"),
        TableColumn("worst", kind="text", of=lambda one: quantity_text(one.value, one.unit, 5)),
        TableColumn("bound", kind="text", of=lambda one: quantity_text(one.bound, one.unit, 5)),
        TableColumn("proved", kind="text", of=proof),
        TableColumn("cells", of="cells"),
        TableColumn("open", "s", digits=2, of=lambda one: one.open_time or None),
    )
    caption = f"{part.name}: {part.title}"
    return ReportTable.of(part.name, caption, columns, part.proof.limits, screen=True)


def model(source: str, name: str, out: Path | None, width: str, *, as_json: bool) -> None:
    """Write the control model of a run folder's estimate, or of a robot."""
    speed = _speed(width)
    with working("model") as terminal:
        outcome = export_model(source, name, out, speed, terminal)
    if as_json:
        write_json({"status": 0, **outcome.summary})
        return
    view = control_models_view({short(outcome.folder): outcome.result})
    print_view(view, results(), short(outcome.folder))


def _speed(text: str) -> float:

    allowed = 'zero and more, such as "2 mm/s"'
    try:
        speed = SPEED.parse(text)
    except PydanticCustomError as error:
        allowed = (error.context or {}).get("allowed", allowed)
        raise InputError(error.message(), key="--smoothing", allowed=allowed) from None
    if speed < 0:
        raise InputError(f"{text} is negative", key="--smoothing", allowed=allowed)
    return speed
