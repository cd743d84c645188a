"""Arguments and options that several commands have, and options that are keys of a section."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import Parameter, signature
from typing import Annotated, Any, NamedTuple

import typer


def argument(metavar: str, text: str) -> Any:
    """Return an argument of a command for an annotation, with its help."""
    return typer.Argument(metavar=metavar, help=text, show_default=False)


def option(name: str, metavar: str, text: str, **further: Any) -> Any:
    """Return an option with a value for an annotation, with its help."""
    return typer.Option(name, metavar=metavar, help=text, **further)


def flag_option(name: str, text: str) -> Any:
    """Return an option without a value for an annotation, with its help."""
    return typer.Option(name, help=text)


RunArgument = Annotated[str, argument("RUN.yaml", "A run file, or the name of a run that ships.")]
JsonOption = Annotated[bool, flag_option("--json", "Write JSON to standard output, for machines.")]


class Option(NamedTuple):
    """An option of a command for a key of a section; `read` returns the value of the key."""

    metavar: str
    help: str
    read: Callable[[str], Any] = str


def with_options(
    options: Mapping[str, Option],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that replaces the ``**options`` of a command by those of the table."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        own = signature(command, eval_str=True)
        *first, last = (one for one in own.parameters.values() if one.kind is not one.VAR_KEYWORD)
        more = [
            Parameter(
                key,
                Parameter.POSITIONAL_OR_KEYWORD,
                default=None,
                annotation=Annotated[str | None, option(flag(key), each.metavar, each.help)],
            )
            for key, each in options.items()
        ]
        # Every function takes the attribute (PEP 362), which mypy does not know.
        command.__signature__ = own.replace(parameters=[*first, *more, last])  # type: ignore[attr-defined]
        return command

    return decorated


def flag(key: str) -> str:
    """Return the option of a key: ``base_radius`` → ``--base-radius``."""
    return f"--{key.replace('_', '-')}"


def _whole(text: str) -> int | str:
    """Return a whole number; the schema refuses any other text."""
    try:
        return int(text)
    except ValueError:
        return text


def _texts(text: str) -> list[str]:
    return [item.strip() for item in text.split(",")]


def _items(text: str, read: Callable[[str], Any] = str) -> Any:
    """Return one item, or a list of several."""
    items = [read(item.strip()) for item in text.split(",")]
    return items[0] if len(items) == 1 else items


_wholes = partial(_items, read=_whole)


EXPORT_OPTIONS = {
    "file": Option("NAME", "Name in DIR/exports; selects one of several tables of the run."),
    "space": Option("strut|pose", "Coordinates of the table."),
    "segment": Option("TIME", "Between two rows, such as '10 ms'; the longest for PVT."),
    "scale": Option("F", "Smaller and slower, for a first run: home + F (λ(F t) − home)."),
    "digits": Option("N", "Digits after the decimal point.", _whole),
    "units": Option("m|mm|um|in|rad|deg|rev", "Unit of lengths; angles are those of motors."),
    "angles": Option("rad|deg", "Unit of angles."),
    "axes": Option("A,B,…", "Six names, in the controller's order.", _items),
    "order": Option("1,2,…", "Number of the strut on each axis.", _wholes),
    "sign": Option("1,-1,…", "Of struts 1 to 6; one for all or six.", _wholes),
    "offset": Option("L,…", "Strut length at which its axis reads zero, or `home`.", _items),
    "counts_per_metre": Option("C,…", "Motor counts; one for all or six.", _items),
    "counts_per_revolution": Option("C,…", "Counts of one turn of a motor.", _items),
    "columns": Option("q,Q,…", "Of csv, without the numbers of struts; q: lengths alone.", _texts),
    "tolerance": Option("L", "Largest deviation of a strut, such as '1 um'."),
    "blend": Option("L", "P of G64 for LinuxCNC."),
    "servo_period": Option("TIME", "Of LinuxCNC's planner, such as '1 ms'."),
    "linear_speed": Option("V,…", "MAX_VELOCITY of LinuxCNC's axes X, Y, Z.", _items),
    "angular_speed": Option("V,…", "MAX_VELOCITY of A, B, C.", _items),
    "linear_acceleration": Option("A,…", "MAX_ACCELERATION of X, Y, Z.", _items),
    "angular_acceleration": Option("A,…", "MAX_ACCELERATION of A, B, C.", _items),
    "path_speed": Option("V", "MAX_LINEAR_VELOCITY of LinuxCNC."),
    "encoding": Option("yaml|mcap", "Of ros2."),
    "repeat": Option("file|controller", "Where a period is repeated."),
    "clock": Option("1/4096 ms|1 ms", "Of the PMAC's row times."),
    "trigger": Option("N", "Digital output that is on in the measurement window.", _whole),
}
"""Options by the keys of `export:`."""


def _points(text: str) -> list[list[str]]:
    return [_texts(point) for point in text.strip().strip(";").split(";")]


INIT_OPTIONS = {
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
        "'X,Y,Z; …'", "Six base joints, base frame, or their name in a file.", _points
    ),
    "platform_joints": Option(
        "'X,Y,Z; …'", "Six platform joints from the TCP, or their name in a file.", _points
    ),
    "strut_length": Option(
        "MIN,MAX", "Lengths of a strut, joint to joint, such as '600 mm, 900 mm'.", _texts
    ),
    "stroke": Option("L", "Stroke of a drive, with home in its middle, instead of lengths."),
    "strut_speed": Option("SPEED", "Largest speed of a strut, such as '300 mm/s'."),
    "strut_acceleration": Option("A", "Largest acceleration of a strut, such as '5 m/s^2'."),
    "actuator_force": Option("FORCE", "Force that a drive holds for long, such as '2 kN'."),
    "mass": Option("MASS", "Mass of the platform with its load, such as '30 kg'."),
    "drive": Option("direct|screw|gear", "What moves the struts."),
    "lead": Option("L", "Travel of a strut in one turn of the motor, such as '5 mm'."),
    "inertia": Option("J", "Inertia of motor and screw about their axis, such as '6e-5 kg m^2'."),
    "force_std": Option("FORCE", "Standard deviation of a measured force."),
    "length_std": Option("L", "Standard deviation of a measured length."),
    "joint_tolerance": Option("L", "Standard deviation of the joints' coordinates."),
    "length_tolerance": Option("L", "Standard deviation of the zero of a measured length."),
    "force_tolerance": Option("SHARE", "Of the force constants, common to all, such as '2 %'."),
    "force_tolerance_each": Option("SHARE", "Of each force constant by itself, such as '1 %'."),
    "gravity_tolerance": Option("ANGLE", "Of the direction of gravity, such as '0.1 deg'."),
    "delay_tolerance": Option("TIME", "Of the forces behind the lengths, such as '0.1 ms'."),
}
"""Options by the keys of `MachineDescription`."""
