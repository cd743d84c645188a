"""Robot file and run file of a new machine, with comments and questions."""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from constraints import limit_definitions
from expdesign.configuration import InputError, load_run, quantity_text
from expdesign.configuration.bodies import BodyDescription
from expdesign.configuration.geometry import JointRing
from expdesign.configuration.limits import CHARACTERISTIC_LENGTH
from expdesign.configuration.parameters import chosen_terms, default_terms
from expdesign.configuration.run import yaml_lines
from expdesign.machines.assumed import MASS, Complete, complete_machine
from expdesign.machines.machine import MachineDraft, Points, format_flow, format_quantity
from expdesign.mechanism.term import Parameter, parameters_of
from expdesign.robot import robot_from
from expdesign.runfolder.files import write_text
from expdesign.templates import text_templates

_HOME_UNITS = ("m", "m", "m", "rad", "rad", "rad")
_WIDTH = 100
_UNITS: dict[str, dict[str, str]] = {
    "ring": {"radius": "m", "half_angle": "rad", "rotation": "rad", "z": "m"},
    "drive": {"lead": "m", "inertia": "kg m^2"},
    "body": {"mass": "kg", "centre": "m"},
    "tolerances": dict.fromkeys(("base_joints", "platform_joints", "strut_length"), "m")
    | {"gravity": "rad", "delay": "s"},
}
"""Units of numbers by their keys, other than 1."""


@dataclass(frozen=True)
class WrittenFiles:
    """The written files."""

    robot: Path
    run: Path
    assumed: tuple[str, ...]
    """Keys of the robot file with assumed values, in alphabetical order; single parameters count
    as `parameters`."""


def file_names(name: str) -> tuple[str, str]:
    """Return the names of robot file and run file of a machine."""
    return f"{name}.yaml", f"{name}-run.yaml"


def write_files(machine: MachineDraft, folder: Path) -> WrittenFiles:
    """Write robot file and run file of a machine; both pass `expdesign check`.

    Unknown values get a documented default and a comment that asks to check it. Existing files are
    refused.
    """
    places = refuse_existing(machine.name, folder)
    complete = complete_machine(machine)
    texts = robot_file(complete), run_file(complete)
    with tempfile.TemporaryDirectory() as elsewhere:
        trial = [Path(elsewhere) / place.name for place in places]
        for place, text in zip(trial, texts, strict=True):
            place.write_text(text, encoding="utf-8")
        try:
            robot_from(load_run(trial[1]).robot)
        except InputError as error:
            # The files are not there: what is wrong is what they were made from.
            raise InputError(replace(p, file=None, line=None) for p in error.problems) from None
    for place, text in zip(places, texts, strict=True):
        write_text(place, text)
    names = _parameters(complete)
    assumed = complete.assumed - {MASS, CHARACTERISTIC_LENGTH}
    keys = {"parameters" if key in names else key for key in assumed}
    keys = {"bodies" if key.startswith("bodies.") else key for key in keys}
    return WrittenFiles(places[0], places[1], tuple(sorted(keys)))


def refuse_existing(name: str, folder: Path) -> list[Path]:
    """Return the paths of a machine's two files; refuse paths that exist."""
    places = [folder / file for file in file_names(name)]
    for place in places:
        if place.exists() or place.is_symlink():
            message = "the file is there already, and is not written over"
            raise InputError(message, place, allowed="another name, or another folder")
    return places


def robot_file(complete: Complete) -> str:
    """Return the text of the robot file."""
    machine, assumed = complete.machine, set(complete.assumed)
    limits = {key: (one.unit, one.title) for key, one in limit_definitions().items()}
    limits[CHARACTERISTIC_LENGTH] = ("m", "scales rotations in condition numbers")
    assumed |= {key for key in ("drive", "alpha_axes") if getattr(machine, key) is None}
    assumed |= set() if machine.tolerances else {"tolerances"}
    if not assumed.isdisjoint(_parameters(complete)):
        assumed.add("parameters")
    keys = {key.partition(".")[0] for key in assumed}
    asked = dict[str, list[str]]()
    for question in machine.questions:
        key = question.key.removeprefix("limits.").removeprefix("noise.")
        asked.setdefault(key, []).append(question.text)
    lengths = complete.lengths
    ends = [quantity_text(1e3 * float(end), "mm", 4) for end in (min(lengths), max(lengths))]

    def questions(key: str, about_assumed: str = "", indent: int = 0) -> str:
        texts = [about_assumed] * (key in keys) + asked.pop(key, [])
        return "".join(_question(text, indent) for text in texts if text)

    text = (
        text_templates("expdesign.machines")
        .get_template("robot.yaml.j2")
        .render(
            machine=machine,
            assumed=assumed,
            asked=questions,
            mark=lambda key: " # assumed" if key in assumed else "",
            flow=format_flow,
            general=complete.general,
            description="".join(yaml_lines("description", machine.source, 0)),
            home=f"[{', '.join(map(format_quantity, machine.home or (), _HOME_UNITS))}]",
            lengths=ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}",
            joints=partial(_joints, complete),
            directions=lambda key: _rows(key, getattr(machine, key), "1"),
            kind="screw" if machine.drive and machine.drive.screw else "gear",
            units=_UNITS,
            mass=quantity_text(machine.moved_mass or 0.0, "kg"),
            bodies=list(_body_lines(complete)),
            parameters=list(_parameter_lines(complete)),
            limits=[
                {
                    "key": key,
                    "value": format_flow(machine.limits[key], unit),
                    "title": title + _assumed_part(key, complete),
                }
                for key, (unit, title) in limits.items()
                if key in machine.limits
            ],
        )
    )
    left = [f"{key}: {one}" for key, texts in asked.items() for one in texts]
    return text + "".join(["\n"] * bool(left) + [_question(one, 0) for one in left])


def run_file(complete: Complete) -> str:
    """Return the text of the run file."""
    robot, run = file_names(complete.machine.name)
    return (
        text_templates("expdesign.machines")
        .get_template("run.yaml.j2")
        .render(
            machine=complete.machine,
            robot_file=robot,
            run_file=run,
            frequency=[format_quantity(f, "Hz") for f in complete.frequency],
        )
    )


def _question(text: str, indent: int) -> str:
    """Return a text as lines of a comment, without control characters."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    lines = textwrap.wrap(line, _WIDTH - indent - 4, break_on_hyphens=False)
    return "".join(f"{' ' * indent}# ? {line}\n" for line in lines)


def _assumed_part(key: str, complete: Complete) -> str:
    """Return the assumed part of a limit, to be appended to its title."""
    if key in complete.assumed:
        return "; assumed"
    prefix = f"{key}."
    parts = [one.removeprefix(prefix) for one in complete.assumed if one.startswith(prefix)]
    return f"; {', '.join(sorted(parts))} assumed" if parts else ""


def _joints(complete: Complete, key: str) -> str:
    """Return the lines of joints: a circle, or six points."""
    joints = getattr(complete.machine, key)
    if not isinstance(joints, JointRing):
        return _rows(key, joints, "m", assumed=key in complete.assumed)
    mark = " # assumed" if key in complete.assumed else ""
    return f"{key}: {format_flow(joints.model_dump(exclude_defaults=True), _UNITS['ring'])}{mark}"


def _rows(key: str, rows: Points, unit: str, *, assumed: bool = False) -> str:
    mark = " # assumed" if assumed else ""
    return "\n".join([f"{key}:{mark}", *(f"  - {format_flow(tuple(row), unit)}" for row in rows)])


def _parameters(complete: Complete) -> dict[str, Parameter]:
    terms = chosen_terms(default_terms(), "general" if complete.general else "symmetric")
    return {parameter.name: parameter for parameter in parameters_of(terms)}


def _body_lines(complete: Complete) -> Iterator[str]:
    """Yield a line for each part, and for each body of one that has several."""
    for part, bodies in dict(complete.machine.bodies or {}).items():
        mark = " # assumed" if f"bodies.{part}" in complete.assumed else ""
        if len(bodies) == 1:
            yield f"{part}: {_body(bodies[0])}{mark}"
        elif bodies:
            yield f"{part}:{mark}"
            yield from (f"  - {_body(body)}" for body in bodies)


def _body(body: BodyDescription) -> str:
    moments = body.inertia if any(body.inertia[3:]) else body.inertia[:3]
    parts = {"centre": body.centre, "inertia": moments}
    stated = {key: values for key, values in parts.items() if any(values)}
    return format_flow({"mass": body.mass} | stated, _UNITS["body"])


def _parameter_lines(complete: Complete) -> Iterator[str]:
    """Yield a line for each parameter; a common meaning is written once."""
    last = ""
    for one in _parameters(complete).values():
        if one.name not in complete.machine.parameters:
            continue
        value = format_quantity(complete.machine.parameters[one.name], "1")
        meaning = "" if one.meaning == last else f": {one.in_words}"
        last = one.meaning
        mark = "; assumed" if one.name in complete.assumed else ""
        yield f"{one.name}: {value} # {one.unit}{meaning}{mark}"


INERTIA = "Which inertia have motor, coupling and screw about their axis, inertia: 6.3e-5 [kg m^2]?"
"""Question about a screw or gear."""
