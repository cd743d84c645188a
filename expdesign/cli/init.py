"""Command `init`: the robot file and the run file of a new machine."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from expdesign.cli.options import INIT_OPTIONS, flag
from expdesign.cli.output import messages, note, say, write_json
from expdesign.configuration import InputError
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.errors import Problem
from expdesign.configuration.schema import validate
from expdesign.machines.importing import MachineDescription, machine_from_answers, read_machine
from expdesign.machines.machine import MachineDraft
from expdesign.machines.writing import WrittenFiles, write_files
from expdesign.stages.execution import refuse_unwritable
from expdesign.stages.stage import short

_CIRCLES = ("base_radius", "base_half_angle", "platform_radius", "platform_half_angle")
_ASKED = (
    *(*_CIRCLES, "home_height", "strut_length", "strut_speed", "strut_acceleration"),
    *("actuator_force", "mass", "drive", "lead", "inertia"),
)


def write_machine(
    name: str,
    out: Path | None,
    sources: Sequence[Path] | None,
    options: Mapping[str, str | None],
    *,
    as_json: bool,
) -> None:
    """Write the files of a machine, from options, files of other programs, and answers."""
    folder = Path.cwd() if out is None else out.absolute()
    refuse_unwritable(folder)
    given = {key: INIT_OPTIONS[key].read(text) for key, text in options.items() if text is not None}
    description = _validated_answers({"name": name, **given})
    known = read_machine(name, sources) if sources else MachineDraft(name)
    if sys.stdin.isatty() and not as_json:
        given = _ask_missing(given, _known_options(known))
        description = _validated_answers({"name": name, **given})
    try:
        files = write_files(machine_from_answers(description, known), folder)
    except InputError as error:
        # Values from a file are named by their keys.
        options_of = given if sources else INIT_OPTIONS
        raise InputError(_with_option(problem, options_of) for problem in error.problems) from None
    if as_json:
        where = {"robot": str(files.robot), "run": str(files.run)}
        write_json({"status": 0, **where, "assumed": files.assumed})
    else:
        _show(files)


def _validated_answers(data: dict[str, Any]) -> Located[MachineDescription]:
    document = document_from_mapping(data)
    try:
        return Located(validate(MachineDescription, document.data, document), document)
    except InputError as error:
        raise InputError(_with_option(one, INIT_OPTIONS) for one in error.problems) from None


def _with_option(problem: Problem, options: Mapping[str, Any]) -> Problem:
    """Return a problem with the option of its key, where there is one."""
    if problem.key == "name":
        return replace(problem, key="NAME")
    parts = problem.key.removeprefix("limits.").removeprefix("noise.").partition("[")
    key = "home_height" if parts[0] == "home" else parts[0]
    return replace(problem, key=flag(key) + parts[1] + parts[2]) if key in options else problem


def _known_options(machine: MachineDraft) -> set[str]:
    """Return the options whose values are known from files."""
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


def _ask_missing(given: dict[str, Any], known: set[str]) -> dict[str, Any]:
    """Ask for values that are neither given nor known; an empty answer leaves a default."""
    found = dict(given)
    messages().print(
        "An empty answer takes a default, with a comment in the file that asks you to check it."
    )
    for key in _ASKED:
        if key not in found and key not in known and _is_useful(key, found):
            # A circle needs all its values.
            answer = _answer(key, needed=key in _CIRCLES and "base_radius" in found)
            found |= {} if answer is None else {key: answer}
    return found


def _is_useful(key: str, given: dict[str, Any]) -> bool:
    """Return whether a question is useful after the other answers."""
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
    """Ask until the answer is valid; None for an empty one."""
    option = INIT_OPTIONS[key]
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
            _validated_answers({"name": "asked", key: value})
        except InputError as error:
            for problem in error.problems:
                allowed = f" (allowed: {problem.allowed})" if problem.allowed else ""
                messages().print(f"  {problem.message}{allowed}")
            continue
        return value


def _show(files: WrittenFiles) -> None:
    robot, run = short(files.robot), short(files.run)
    say(f"written to {robot} and {run}")
    if files.assumed:
        note(f"defaults to check (`# ?` in {robot}): {', '.join(files.assumed)}")
    note(f"next: expdesign check {run}")
