"""`expdesign init`: robot file and run file of one's own machine."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.options import Option, flag, with_options
from expdesign.cli.output import JsonOption, messages, note, say, write_json

if TYPE_CHECKING:
    from expdesign.configuration.document import Placed
    from expdesign.configuration.errors import Problem
    from expdesign.machines.description import MachineDescription
    from expdesign.machines.machine import Machine
    from expdesign.machines.writing import WrittenFiles


def _pair(text: str) -> list[str]:
    return [end.strip() for end in text.split(",")]


def _points(text: str) -> list[list[str]]:
    return [_pair(point) for point in text.strip().strip(";").split(";")]


_OPTIONS = {
    "base_radius": Option("L", "Radius of the circle of the base joints, such as '450 mm'."),
    "base_half_angle": Option(
        "ANGLE", "Between a base joint and the middle of its pair, such as '8 deg'."
    ),
    "platform_radius": Option("L", "Radius of the circle of the platform joints."),
    "platform_half_angle": Option(
        "ANGLE", "Between a platform joint and the middle of its pair; struts 2 and 3 meet there."
    ),
    "home_height": Option("L", "Height of the TCP over the base at home; negative: it hangs."),
    "platform_z": Option("L", "Height of the platform joints over the TCP; 0 by default."),
    "base_joints": Option(
        "'X,Y,Z; …'", "Six base joints, base frame, in place of a circle.", _points
    ),
    "platform_joints": Option(
        "'X,Y,Z; …'", "Six platform joints from the TCP, in place of a circle.", _points
    ),
    "strut_length": Option(
        "MIN,MAX", "Lengths of a strut, joint to joint, such as '600 mm, 900 mm'.", _pair
    ),
    "stroke": Option("L", "Way of a drive, with home in its middle, in place of lengths."),
    "strut_speed": Option("SPEED", "Largest speed of a strut, such as '300 mm/s'."),
    "strut_acceleration": Option("A", "Largest acceleration of a strut, such as '5 m/s^2'."),
    "actuator_force": Option("FORCE", "Force that a drive holds for long, such as '2 kN'."),
    "mass": Option("MASS", "Mass of the platform with what it carries, such as '30 kg'."),
    "drive": Option("direct|screw|gear", "What moves the struts."),
    "lead": Option("L", "Travel of a strut in one turn of the motor, such as '5 mm'."),
    "inertia": Option("J", "Inertia of motor and screw about their axis, such as '6e-5 kg m^2'."),
    "force_std": Option("FORCE", "Standard deviation of a measured force."),
    "length_std": Option("L", "Standard deviation of a measured length."),
}
"""By key of `MachineDescription`."""

_CIRCLES = ("base_radius", "base_half_angle", "platform_radius", "platform_half_angle")
_ASKED = (
    *(*_CIRCLES, "home_height", "strut_length", "strut_speed", "strut_acceleration"),
    *("actuator_force", "mass", "drive", "lead", "inertia"),
)


@with_options(_OPTIONS)
def init(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Of the machine.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="The folder; the current one by default."),
    ] = None,
    sources: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="A file of another program that describes the machine, such as LinuxCNC's INI and "
            "HAL; several times for several. Options override what it says.",
        ),
    ] = None,
    as_json: JsonOption = False,
    **options: str | None,
) -> None:
    """Write a robot file and a run file for a machine of your own, NAME.yaml and NAME-run.yaml.

    Both have comments and pass `expdesign check`. What no option says is asked for on a terminal;
    an empty answer leaves it open. What stays open is assumed, marked so, and stands in the file as
    a question. A file that is there is never written over.
    """
    from expdesign.configuration import InputError
    from expdesign.machines.description import machine_from_answers
    from expdesign.machines.importing import read_machine
    from expdesign.machines.machine import Machine
    from expdesign.machines.writing import write_files
    from expdesign.stages.folder import refuse_unwritable

    folder = Path.cwd() if out is None else out.absolute()
    refuse_unwritable(folder)
    given = {key: _OPTIONS[key].read(text) for key, text in options.items() if text is not None}
    told = _told({"name": name, **given})
    known = read_machine(name, sources) if sources else Machine(name)
    if sys.stdin.isatty() and not as_json:
        given = _answered(given, _known(known))
        told = _told({"name": name, **given})
    try:
        files = write_files(machine_from_answers(told, known), folder)
    except InputError as error:
        # What comes from a file has the key that it would have had.
        options_of = given if sources else _OPTIONS
        raise InputError(_with_option(problem, options_of) for problem in error.problems) from None
    if as_json:
        where = {"robot": str(files.robot), "run": str(files.run)}
        write_json({"status": 0, **where, "assumed": files.assumed})
    else:
        _show(files)


def _told(data: dict[str, Any]) -> Placed[MachineDescription]:
    from expdesign.configuration import InputError
    from expdesign.configuration.document import Placed, document_from_mapping
    from expdesign.configuration.section import validate
    from expdesign.machines.description import MachineDescription

    document = document_from_mapping(data)
    found, problems = validate(MachineDescription, document.data, document)
    if found is None:
        raise InputError(_with_option(problem, _OPTIONS) for problem in problems)
    return Placed(found, document)


def _with_option(problem: Problem, options: Mapping[str, Any]) -> Problem:
    """Return a problem with the option that it is about, where it is one, in place of a key."""
    from dataclasses import replace

    if problem.key == "name":
        return replace(problem, key="NAME")
    parts = problem.key.removeprefix("limits.").removeprefix("noise.").partition("[")
    key = "home_height" if parts[0] == "home" else parts[0]
    return replace(problem, key=flag(key) + parts[1] + parts[2]) if key in options else problem


def _known(machine: Machine) -> set[str]:
    """Return what need not be asked of a machine: by the options that would say it."""
    found = set(machine.limits)
    for end in ("base", "platform"):
        if getattr(machine, f"{end}_joints") is not None:
            found |= {f"{end}_radius", f"{end}_half_angle"}
    there = {
        "home_height": machine.home is not None,
        "mass": machine.moved_mass is not None or "p10" in machine.parameters,
        "drive": machine.drive is not None,
    }
    return found | {key for key, known in there.items() if known}


def _answered(given: dict[str, Any], known: set[str]) -> dict[str, Any]:
    """Ask for what is neither given nor known; an empty answer leaves it open."""
    found = dict(given)
    messages().print("An empty answer leaves a question open: it then stands in the file.")
    for key in _ASKED:
        if key not in found and key not in known and _sensible(key, found):
            # A circle that is begun is not left half told.
            answer = _answer(key, needed=key in _CIRCLES and "base_radius" in found)
            found |= {} if answer is None else {key: answer}
    return found


def _sensible(key: str, given: dict[str, Any]) -> bool:
    """Return whether there is a use in asking: nothing that another answer says already."""
    if key in _CIRCLES:
        end = key.partition("_")[0]
        begun = key == "base_radius" or "base_radius" in given or "base_joints" in given
        return begun and f"{end}_joints" not in given
    if key == "lead":
        return given.get("drive") in ("screw", "gear")
    if key == "inertia":
        return "lead" in given
    return not (key == "strut_length" and "stroke" in given)


def _answer(key: str, *, needed: bool) -> Any:
    """Ask until the answer can be used; None for an empty one."""
    from expdesign.configuration import InputError

    option = _OPTIONS[key]
    choices = f" ({option.metavar})" if "|" in option.metavar else ""
    question = f"{option.help.rstrip('.')}{choices}"
    while True:
        text = typer.prompt(question, "", show_default=False, err=True)
        if not text.strip():
            if not needed:
                return None
            messages().print("  needed with the radius of the base")
            continue
        value = option.read(text.strip())
        try:
            _told({"name": "asked", key: value})
        except InputError as error:
            for problem in error.problems:
                allowed = f" (allowed: {problem.allowed})" if problem.allowed else ""
                messages().print(f"  {problem.message}{allowed}")
            continue
        return value


def _show(files: WrittenFiles) -> None:
    from expdesign.stages.outcome import short

    robot, run = short(files.robot), short(files.run)
    say(f"written to {robot} and {run}")
    if files.assumed:
        note(f"assumed, for you to look up (`# ?` in {robot}): {', '.join(files.assumed)}")
    note(f"next: expdesign check {run}")
