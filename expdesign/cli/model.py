"""`expdesign model`: the identified robot in a form that a controller runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from expdesign.cli.output import JsonOption, results, say, write_json

if TYPE_CHECKING:
    from estimation.controlmodel.formats import ControlModelFile

_WIDTH = "--smoothing"


def model(
    source: Annotated[
        str,
        typer.Argument(
            metavar="DIR",
            help="A run folder with an estimate; or a robot file, or the name of a robot that "
            "ships, whose nominal parameters are then taken.",
            show_default=False,
        ),
    ],
    name: Annotated[
        str,
        typer.Option(
            "--format", metavar="NAME", help="c, python, fmu or simulink; has to be given."
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="The folder; DIR/model/NAME by default."),
    ] = None,
    width: Annotated[
        str,
        typer.Option(
            _WIDTH,
            metavar="SPEED",
            help="Width of the sign of dry friction, such as '2 mm/s': tanh in place of the sign. "
            "0: the exact one.",
        ),
    ] = "0",
    as_json: JsonOption = False,
) -> None:
    """Write inverse dynamics and kinematics of the identified robot for a controller.

    C99 source, a Python module, an FMU or an S-function for Simulink, each with states to test it
    against; model.json says where the numbers come from, and how uncertain the forces are along
    the design. With a C compiler here, the code is built, tested and timed before it is written.
    """
    from expdesign.cli.terminal import working
    from expdesign.stages.model import export_model
    from expdesign.stages.outcome import short

    speed = _speed(width)
    with working("model") as terminal:
        outcome = export_model(source, name, out, speed, terminal)
    if as_json:
        write_json({"status": 0, **outcome.summary})
        return
    record: ControlModelFile = outcome.result
    say(f"{record.title}, from {record.origin.sentence}")
    _print(record)
    say(f"written to {short(outcome.folder)}")


def _speed(text: str) -> float:
    from pydantic_core import PydanticCustomError

    from expdesign.configuration import InputError
    from expdesign.configuration.quantity import SPEED

    allowed = 'zero and more, such as "2 mm/s"'
    try:
        speed = SPEED.parse(text)
    except PydanticCustomError as error:
        allowed = (error.context or {}).get("allowed", allowed)
        raise InputError(error.message(), key=_WIDTH, allowed=allowed) from None
    if speed < 0:
        raise InputError(f"{text} is negative", key=_WIDTH, allowed=allowed)
    return speed


def _print(record: ControlModelFile) -> None:
    from rich import box
    from rich.table import Table

    if record.uncertainty:
        title = f"Standard deviation of the forces along {record.motion}, N"
        table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
        for head in ("actuator", "rms", "largest", "rms, random share", "largest force"):
            table.add_column(head, justify="right")
        for one in record.uncertainty:
            cells = (one.rms, one.largest, one.rms_random, one.largest_force)
            table.add_row(str(one.actuator), *(f"{cell:.3g}" for cell in cells))
        results().print(table)
    for test in record.tests:
        time = ""
        if test.median is not None and test.worst is not None and test.most is not None:
            time = (
                f"; a call takes {1e6 * test.median:.3g} µs (median), {1e6 * test.most:.3g} µs "
                f"(99.9 %), {1e6 * test.worst:.3g} µs (longest)"
            )
        say(
            f"tested in {test.precision} precision ({test.compiler}): forces off by "
            f"{test.deviation:.2g} N at most{time}"
        )
