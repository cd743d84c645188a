"""`expdesign export`: controller tables of the designed motion, each checked by reading it back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import refuse_unwritable
from expdesign.cli.output import JsonOption, note, results, short, warn_all, write_json

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration
    from expdesign.export import Export, Task
    from expdesign.motion import ExecutableMotion
    from expdesign.schema import ExportSection
    from expdesign.trajectory import FourierTrajectory

STAGE = "export"
FOLDER, RECORD, README = "exports", "exports.json", "README.txt"

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
FileOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File to write; in DIR/exports by default."),
]


def _text_option(name: str, metavar: str, text: str) -> Any:
    return typer.Option(f"--{name}", metavar=metavar, help=text)


def export(  # noqa: PLR0917 - each is an option of the command
    folder: FolderArgument = None,
    name: FormatOption = "",
    out: FileOption = None,
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
    from expdesign.configuration import ConfigurationError, Problem
    from expdesign.export import file_name, refuse_missing_library

    if name == _LIST:
        _list(as_json=as_json)
        return
    if folder is None:
        raise ConfigurationError(Problem("no run folder is given", allowed="expdesign export DIR"))
    given = {
        "space": space,
        "segment": segment,
        "units": units,
        "angles": angles,
        "tolerance": tolerance,
        "blend": blend,
        "encoding": encoding,
        "digits": _whole(digits),
        "axes": _items(axes),
        "offset": _one_or_list(offset),
        "order": _numbers(order),
        "sign": _one_or_list(sign, whole=True),
        "counts_per_metre": _one_or_list(counts_per_metre),
    }
    folder = folder.absolute()
    configuration = _configuration(folder)
    section = _section(name, {k: v for k, v in given.items() if v is not None}, configuration)
    refuse_missing_library(section)
    path = (folder / FOLDER / file_name(section)) if out is None else out.absolute()
    refuse_unwritable(path.parent)
    warn_all(configuration.warnings)
    task = _task(configuration, _trajectory(folder))
    made = _exported(section, task, path, "", as_json=as_json)
    if out is None:
        _describe(path.parent, task, {path.name: made}, keep=True)
    else:
        _describe_beside(path, task, made)
    if as_json:
        write_json({"status": 0, **_summary(task, [made])})
    else:
        results().print(f"written to {short(path)}")


def export_stage(configuration: RunConfiguration, folder: Path, *, as_json: bool) -> dict[str, Any]:
    """Write every table that the run names, with README.txt and exports.json.

    Raises
    ------
    ConfigurationError
        The design is missing or none, or an option cannot be kept.
    CommandFailed
        A table is beyond a tolerance, or the machine cannot get into the motion.
    """
    from expdesign.cli.stages import clear_outdated, record_stage
    from expdesign.export import file_name, refuse_missing_library

    for number, section in enumerate(configuration.run.export, start=1):
        refuse_missing_library(section, f"export[{number}]")
    trajectory = _trajectory(folder)
    refuse_unwritable(folder)
    target = folder / FOLDER
    made_from = folder_motion(folder)
    with record_stage(STAGE, configuration, folder, made_from) as stage:
        task = _task(configuration, trajectory)
        clear_outdated(STAGE, configuration, folder, made_from)
        made: dict[str, Export] = {}
        for number, section in enumerate(configuration.run.export, start=1):
            path = target / file_name(section)
            place = f"export[{number}]"
            made[path.name] = _exported(section, task, path, place, as_json=as_json)
        described = _describe(target, task, made, keep=False)
        stage.files = [*(export.path for export in made.values()), *described]
        stage.status = "done"
    if not as_json:
        results().print(f"written to {short(target)}")
    return {"folder": str(folder), **_summary(task, list(made.values()))}


def folder_motion(folder: Path) -> str:
    """Return what the tables of a run folder are made from: the coefficients of its design."""
    return " ".join(value.hex() for value in _trajectory(folder).vector().tolist())


def _list(*, as_json: bool) -> None:
    from rich.table import Table

    from expdesign.export import table_formats
    from expdesign.schema.export import OFFERS

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


def _configuration(folder: Path) -> RunConfiguration:
    from expdesign.configuration import ConfigurationError, Problem, load_run

    file = folder / "run.yaml"
    if not file.is_file():
        raise ConfigurationError(
            Problem(
                "this is no run folder: it has no run.yaml",
                file=folder,
                key="DIR",
                allowed="a folder that `expdesign design` or `expdesign run` wrote",
            )
        )
    return load_run(file)


def _section(name: str, given: dict[str, Any], configuration: RunConfiguration) -> ExportSection:
    """Return what is asked for: the run's own options for the format, overridden by these."""
    from dataclasses import replace

    from expdesign.configuration import ConfigurationError
    from expdesign.configuration.document import document_from_mapping
    from expdesign.configuration.validation import validate
    from expdesign.schema import ExportSection

    named = (entry for entry in configuration.run.export if entry.format == name)
    stated = next(named, None)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    if "counts_per_metre" in given:
        data.pop("units", None)
    if "units" in given:
        data.pop("counts_per_metre", None)
    data |= {"format": name, **given}
    found, problems = validate(ExportSection, data, document_from_mapping(data))
    if found is None:
        raise ConfigurationError(
            replace(problem, key=f"--{problem.key.replace('_', '-')}") for problem in problems
        )
    return found


def _trajectory(folder: Path) -> FourierTrajectory:
    from expdesign.trajectory import read_design_file

    return read_design_file(folder).trajectory


def _task(configuration: RunConfiguration, trajectory: FourierTrajectory) -> Task:
    from expdesign.experiment.design import judged_parameters
    from expdesign.export import Task
    from expdesign.robot import robot_from

    run = configuration.run
    robot = robot_from(configuration.robot)
    noise = configuration.robot.noise
    return Task(
        name=run.name,
        robot=robot,
        motion=_motion(configuration, trajectory),
        controller_period=run.trajectory.controller_period or run.experiment.step,
        sampling=run.experiment.sampling,
        parameters=judged_parameters(configuration, robot),
        force_covariance=None if noise is None else noise.force_covariance,
    )


def _motion(configuration: RunConfiguration, trajectory: FourierTrajectory) -> ExecutableMotion:
    from expdesign.motion import NoRampError, executable_motion

    note("looking for the ways from rest into the motion and back")
    try:
        return executable_motion(configuration, trajectory)
    except NoRampError as error:
        raise CommandFailed(str(error)) from error


def _exported(
    section: ExportSection, task: Task, path: Path, place: str, *, as_json: bool
) -> Export:
    from expdesign.export import ExportError, export_table

    try:
        made = export_table(section, task, path, place)
    except ExportError as error:
        raise CommandFailed(
            f"{error}. The file was not kept; a shorter segment, more digits or a larger "
            "tolerance may help.",
            {"failures": list(error.check.failures)},
        ) from error
    if not as_json:
        check = made.check
        off = check.deviation
        results().print(
            f"{path.name}: {check.rows} rows in {check.duration:.3f} s, read back: struts within "
            f"{1e6 * off.position:.3g} µm and {1e3 * off.velocity:.3g} mm/s of the design, every "
            "limit kept"
        )
    return made


def _describe(
    folder: Path, task: Task, made: dict[str, Export], *, keep: bool
) -> tuple[Path, Path]:
    """Write README.txt and exports.json; `keep` what they say of other files of the same motion."""
    from expdesign.export import file_record, motion_record, readme
    from expdesign.runfolder.atomic import write_json as write_record
    from expdesign.runfolder.atomic import write_text

    motion = motion_record(task)
    files = _known(folder, motion) if keep else {}
    files |= {name: file_record(export) for name, export in made.items()}
    write_record(folder / RECORD, {"motion": motion, "files": files})
    write_text(folder / README, readme(motion, files))
    return folder / RECORD, folder / README


def _known(folder: Path, motion: dict[str, Any]) -> dict[str, Any]:
    try:
        data = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        if data["motion"] != json.loads(json.dumps(motion)):
            return {}
        return {name: record for name, record in data["files"].items() if (folder / name).exists()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _describe_beside(path: Path, task: Task, made: Export) -> None:
    from expdesign.export import file_record, motion_record, readme
    from expdesign.runfolder.atomic import write_json as write_record
    from expdesign.runfolder.atomic import write_text

    motion, files = motion_record(task), {path.name: file_record(made)}
    write_record(path.with_name(f"{path.name}.json"), {"motion": motion, "files": files})
    write_text(path.with_name(f"{path.name}.README.txt"), readme(motion, files))


def _summary(task: Task, made: list[Export]) -> dict[str, Any]:
    from expdesign.export import file_record, motion_record

    return {
        "motion": motion_record(task),
        "files": {str(export.path): file_record(export) for export in made},
    }


def _items(text: str | None) -> list[str] | None:
    return None if text is None else [item.strip() for item in text.split(",")]


def _whole(text: str | None) -> int | str | None:
    """Return a whole number; text that is none is left to the schema, which refuses it."""
    try:
        return None if text is None else int(text)
    except ValueError:
        return text


def _numbers(text: str | None) -> list[Any] | None:
    return None if text is None else [_whole(item) for item in _items(text) or []]


def _one_or_list(text: str | None, *, whole: bool = False) -> Any:
    items = _numbers(text) if whole else _items(text)
    return items[0] if items is not None and len(items) == 1 else items
