"""Commands `init` and `init-data`: files of a new machine, and the section of a recording."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from estimation.data.guess import guess_files
from expdesign.cli.options import INIT_OPTIONS, flag
from expdesign.cli.output import messages, note, say, write_json
from expdesign.configuration import InputError, load_run
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.errors import Problem
from expdesign.configuration.estimate import name_in_run_file
from expdesign.configuration.run import yaml_lines
from expdesign.configuration.schema import validate
from expdesign.machines.importing import MachineDescription, machine_from_answers, read_machine
from expdesign.machines.machine import MachineDraft
from expdesign.machines.writing import WrittenFiles, refuse_existing, write_files
from expdesign.runfolder.files import write_text
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
    names = _names_of_sets(given) if sources else {}
    _validated_answers({"name": name, **given})
    refuse_existing(name, folder)
    known = read_machine(name, sources, names) if sources else MachineDraft(name)
    if sys.stdin.isatty() and not as_json:
        begun = [*(f"--from {shlex.quote(str(file))}" for file in sources or ())]
        begun += [f"{flag(f'{end}_joints')} {shlex.quote(one)}" for end, one in names.items()]
        files = _ask_and_write(name, given, known, folder, begun)
    else:
        # Values from a file are named by their keys.
        files = _write(name, given, known, folder, given if sources else INIT_OPTIONS)
    if as_json:
        where = {"robot": str(files.robot), "run": str(files.run)}
        write_json({"status": 0, **where, "assumed": files.assumed})
    else:
        _show(files)


def _names_of_sets(given: dict[str, Any]) -> dict[str, str]:
    """Remove the names of a file's sets of joints from the answers; return them by their ends."""
    ends = ("base", "platform")
    found = {end: given.get(f"{end}_joints", []) for end in ends}
    names = {end: one[0][0] for end, one in found.items() if [len(each) for each in one] == [1]}
    for end in names:
        del given[f"{end}_joints"]
    return names


def _write(
    name: str,
    given: Mapping[str, Any],
    known: MachineDraft,
    folder: Path,
    options: Mapping[str, Any],
) -> WrittenFiles:
    description = _validated_answers({"name": name, **given})
    try:
        return write_files(machine_from_answers(description, known), folder)
    except InputError as error:
        raise InputError(_with_option(problem, options) for problem in error.problems) from None


def _ask_and_write(
    name: str, options: Mapping[str, Any], known: MachineDraft, folder: Path, begun: Sequence[str]
) -> WrittenFiles:
    """Ask for missing values and write the files; answers that contradict are asked for again.

    If this ends, a command is printed with the options that it had `begun` with and the answers.
    """
    given = dict(options)
    try:
        _ask_missing(given, _known_options(known))
        while True:
            try:
                return _write(name, given, known, folder, INIT_OPTIONS)
            except InputError as error:
                for problem in error.problems:
                    messages().print(f"  {problem}")
                named = {problem.key.partition("[")[0] for problem in error.problems}
                before = dict(given)
                for key in (key for key in INIT_OPTIONS if flag(key) in named):
                    answer = _answer(key, needed=False)
                    given.pop(key, None)
                    given |= {} if answer is None else {key: answer}
                if given == before:
                    raise
    except (InputError, typer.Abort):
        answers = [f"{flag(key)} {shlex.quote(_text(value))}" for key, value in given.items()]
        # One line, which a terminal wraps and a user can paste.
        console = messages()
        console.soft_wrap = True
        command = " ".join(["expdesign init", name, *begun, *answers])
        note(f"the answers so far: {command}", console)
        raise


def _text(value: Any) -> str:
    """Return an answer as the text of its option."""
    if not isinstance(value, list):
        return str(value)
    return ("; " if isinstance(value[0], list) else ", ").join(map(_text, value))


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


def _ask_missing(given: dict[str, Any], known: set[str]) -> None:
    """Ask for values that are neither given nor known; an empty answer leaves a default."""
    messages().print(
        "An empty answer takes a default, with a comment in the file that asks you to check it."
    )
    for key in _ASKED:
        if key not in given and key not in known and _is_useful(key, given):
            # A circle needs all its values.
            answer = _answer(key, needed=key in _CIRCLES and "base_radius" in given)
            given |= {} if answer is None else {key: answer}


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
            (problem, *_) = error.problems
            allowed = f" (allowed: {problem.allowed})" if problem.allowed else ""
            messages().print(f"  {problem.message}{allowed}")
            meant = problem.nearest if isinstance(value, str) else None
            if not (meant and typer.confirm(f"  {meant}?", err=True)):
                continue
            value = meant
        return value


def write_data_section(
    file: Path, forces: Path | None, run: str | None, out: Path | None, *, as_json: bool
) -> None:
    """Print the guessed section `data` for a recording, or write it to a new file."""
    if out is not None:
        refuse_unwritable(out.absolute().parent)
        if out.exists():
            raise InputError("the file exists", out, key="--out", allowed="a new file")
    robot, place = None, None
    if run is not None:
        configuration = load_run(run)
        robot = configuration.robot
        place = configuration.file
    guess = guess_files(file, forces, robot)
    section = {"file": name_in_run_file(place, file), **guess.section}
    if forces is not None:
        names = (name_in_run_file(place, one) for one in (file, forces))
        pair = dict(zip(("lengths", "forces"), names, strict=True))
        section = {"files": pair, **guess.section}
    if as_json:
        found = {"data": section, "facts": guess.facts, "questions": guess.questions}
        write_json({"status": 0, **found})
        return
    comments = [*guess.facts, *(f"? {text}" for text in guess.questions)]
    text = "".join([*yaml_lines("data", section, 0), *(f"  # {one}\n" for one in comments)])
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_text(out, text)
        say(f"written to {short(out.absolute())}")
    asked = len(guess.questions)
    if asked:
        note(f"{asked} line{'s' if asked > 1 else ''} with `# ?` to answer")


def _show(files: WrittenFiles) -> None:
    robot, run = short(files.robot), short(files.run)
    say(f"written to {robot} and {run}")
    if files.assumed:
        note(f"defaults to check (`# ?` in {robot}): {', '.join(files.assumed)}")
    note(f"next: expdesign check {run}")
