"""`expdesign check`: a run validated and complete, and the machine at home with its reach."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.output import JsonOption, RunArgument, note, warn, write_json

if TYPE_CHECKING:
    from expdesign.configuration import ResolvedRobot, RunConfiguration
    from expdesign.recheck.excitable import Excitable
    from expdesign.robot import Robot

MachineOption = Annotated[
    bool,
    typer.Option(
        "--machine",
        help="Print the machine at home in place of the configuration, with the reach of every "
        "coordinate, and draw it.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Of --machine: the run folder, whose figures/ get the drawing; runs/NAME by default.",
    ),
]


def check(
    run: RunArgument,
    machine: MachineOption = False,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Validate a run and print its complete configuration, with every default, in SI units.

    Nothing is computed but whether the home pose keeps the limits. Warnings, limits that are not
    set or stand by default, what `expdesign run` would do, and the pairs of struts that share a
    joint and are left out of the clearance, go to standard error.

    With --machine the robot is computed with: lengths, forces and angles of the struts and the
    condition at home, how far each coordinate goes from there alone until which limit stops it, and
    which parameters motions within the limits can tell apart. It is drawn into figures/machine.png
    and machine.svg of the run folder.
    """
    from expdesign.configuration import InputError, load_run, resolved_yaml
    from expdesign.configuration.bodies import bodies_in_words
    from expdesign.configuration.open_rows import (
        defaults_in_words,
        held_in_words,
        open_in_words,
        open_rows,
        reserve_in_words,
    )
    from expdesign.robot import robot_from
    from expdesign.stages.folder import run_folder
    from expdesign.stages.run import refuse_unfit
    from expdesign.stages.table import left_out, named, performed, stages_without_design

    if out is not None and not machine:
        message = "nothing is written without --machine"
        raise InputError(message, key="--out", allowed="--machine, or no --out")
    configuration = load_run(run)
    robot = robot_from(configuration.robot)
    refuse_unfit(configuration)
    pairs = [(i + 1, j + 1) for i, j in configuration.robot.shared_joint_pairs]
    done = performed(configuration)
    warnings = list(configuration.warnings)
    open_limits, defaults = open_rows(configuration.robot), defaults_in_words(configuration.robot)
    held, reserve = held_in_words(configuration.robot), reserve_in_words(configuration.robot)
    if open_limits:
        warnings.append(f"{open_in_words(open_limits)}: a design may go there as far as it gets")
    warnings += _noise_not_stated(configuration.robot)
    if missing := stages_without_design(configuration, run_folder(configuration, None)):
        warnings.append(f"expdesign run refuses this file. {missing.message}")
    about = configuration.robot
    made = bodies_in_words(
        about.description.bodies, about.platform_joints, about.description.parameters
    )
    found = {}
    if machine:
        found = _machine(configuration, robot, run_folder(configuration, out), quiet=as_json)
        warnings += found.pop("warnings")
    if as_json:
        write_json(
            {
                "status": 0,
                "file": None if configuration.file is None else str(configuration.file),
                "stages": configuration.run.stages,
                "run_does": done,
                "designs": [point.name for point in configuration.grid],
                "configuration": configuration.run.model_dump(mode="json", by_alias=True),
                "shared_joints": pairs,
                "limits_not_set": [str(one) for one in open_limits],
                "limits_by_default": defaults,
                "limits_held_by_others": held,
                "reserve": {key: one.reserve for key, one in configuration.robot.limits.items()},
                "bodies": made,
                "within_rounding": about.rounded,
                "warnings": warnings,
                **found,
            }
        )
        return
    if not machine:
        typer.echo(resolved_yaml(configuration), nl=False)
    unnamed = "" if configuration.run.stages else " (the file names no stage)"
    note(f"expdesign run does: {', '.join(done) or 'nothing'}{unnamed}")
    for stage in named(configuration):
        if reason := left_out(stage, configuration):
            note(f"{stage}: left out, {reason}")
    for first, second in pairs:
        note(f"struts {first} and {second} share a joint: left out of the strut clearance")
    for text in (
        *_designs_in_words(configuration),
        *defaults,
        *held,
        *([reserve] if reserve else []),
        *([about.rounded] if about.rounded else []),
        *_constants_in_words(robot),
    ):
        note(text)
    if made:
        note(made)
    for warning in warnings:
        warn(warning)


def _constants_in_words(robot: Robot) -> list[str]:
    """Return which constants of terms an estimate finds, and from where on."""
    from expdesign.configuration import quantity_text
    from expdesign.robot.deviation import estimated_constants

    found = []
    for one in estimated_constants(robot):
        prior = f"a prior of ± {quantity_text(one.std, one.unit)} (tolerances.{one.group})"
        term, constant = one.group.split(".")[1:]
        described = next(t for t in robot.description.description.terms if t.name == term)
        value = quantity_text(described.constants[constant].value, one.unit)
        found.append(
            f"{term}.{constant} is estimated from {value} on, with "
            f"{prior if one.std < float('inf') else 'no prior'}"
        )
    return found


def _designs_in_words(configuration: RunConfiguration) -> list[str]:
    """Return how many designs a sweep makes, and of what; nothing without one."""
    from expdesign.configuration.grid import value_text

    lists = [
        f"{path} {' | '.join(value_text(value) for value in values)}"
        for path, values in (configuration.run.sweep or {}).items()
    ]
    count = len(configuration.grid)
    designs = f"{count} design{'' if count == 1 else 's'}"
    return [f"the sweep makes {designs}: {', '.join(lists)}"] if lists else []


def _machine(
    configuration: RunConfiguration, robot: Robot, folder: Path, *, quiet: bool
) -> dict[str, Any]:
    """Compute, print and draw the machine at home; return the same for machines."""
    from dataclasses import asdict

    from constraints import limit_definitions
    from expdesign.cli.machine import print_machine
    from expdesign.cli.output import say
    from expdesign.cli.terminal import working
    from expdesign.recheck.excitable import excitable
    from expdesign.recheck.reach import reach
    from expdesign.robot import LimitModel
    from expdesign.stages.folder import refuse_unwritable
    from expdesign.stages.outcome import short
    from results.saving import machine_drawing

    refuse_unwritable(folder)
    with working("check"):
        at_home, reaches = LimitModel.boundless(robot).at_home(), reach(robot)
        shown = excitable(robot)
        files = machine_drawing(robot, folder, configuration.run.report.figures)
    if not quiet:
        print_machine(robot, at_home, reaches)
        say(f"{_shown_in_words(shown)}\n")
        say(f"drawn: {', '.join(short(file) for file in files)}")
    units = {key: definition.unit for key, definition in limit_definitions().items()}
    return {
        "machine": {
            "at_home": {
                key: {"values": values.tolist(), "unit": units[key]}
                for key, values in at_home.items()
            },
            "reach": {one.coordinate: asdict(one) for one in reaches},
            "base_parameters": {name: shown.base.members(name) for name in shown.base.base},
            "files": [str(file) for file in files],
        },
        "warnings": _not_shown(configuration, robot, shown),
    }


def _shown_in_words(found: Excitable) -> str:
    """Return how many parameters some motion within the limits tells apart."""
    told, every = len(found.base.base), len(found.base.names)
    if told == every:
        return f"Motions within the limits tell all {every} parameters apart."
    combined = [found.base.text(name) for name in found.base.combined]
    text = f"Motions within the limits tell {told} of {every} parameters"
    return f"{text}, together with others: {', '.join(combined)}." if combined else f"{text}."


def _not_shown(configuration: RunConfiguration, robot: Robot, found: Excitable) -> list[str]:
    """Return warnings of parameters that no motion within the limits shows, or none measures."""
    from expdesign.information.identifiable import IDENTIFIABLE

    warnings = []
    if found.base.regrouped:
        told = "; ".join(found.base.sentences())
        warnings.append(
            f"no motion within the limits tells all parameters: {told}. Design and estimate what "
            "shows (design.parameters: base, estimate.parameters: base), or leave a term out"
        )
    run, noise = configuration.run, configuration.robot.noise
    if noise is None or noise.force_covariance is None or noise.force_spectrum is not None:
        return warnings
    longest = run.experiment.periods / run.trajectory.frequency[0]
    weak = found.beyond_noise(robot, longest * run.experiment.sampling)
    if weak:
        told = ", ".join(f"{name} ({100 * share:.2g} %)" for name, share in weak.items())
        warnings.append(
            f"no motion within the limits identifies {told} in {longest:.4g} s of measuring, the "
            "longest of this run: in brackets the standard deviation at best, which is to be below "
            f"{100 * IDENTIFIABLE:g} % of the value"
        )
    return warnings


def _noise_not_stated(robot: ResolvedRobot) -> list[str]:
    from expdesign.configuration.noise import NOISE_FROM_DATA

    if robot.noise is not None and robot.noise.force_covariance is not None:
        return []
    return [
        "the noise of the forces is not stated (noise.force_std), and a design needs it: "
        f"{NOISE_FROM_DATA}"
    ]
