"""Command `check`: a validated and complete run, and the machine at home with its reach."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from expdesign.cli.output import note, warn, write_json
from expdesign.configuration import (
    InputError,
    ResolvedRobot,
    RunConfiguration,
    load_run,
    quantity_text,
    resolved_yaml,
)
from expdesign.configuration.bodies import bodies_in_words
from expdesign.configuration.grid import value_text
from expdesign.configuration.noise import NOISE_FROM_DATA
from expdesign.configuration.open_rows import (
    defaults_in_words,
    held_in_words,
    open_in_words,
    open_rows,
    reserve_in_words,
)
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import estimated_constants
from expdesign.stages.folder import run_folder
from expdesign.stages.registry import missing_design, named_stages, performed_stages
from expdesign.stages.run import refuse_unfit


def check(run: str, out: Path | None, *, machine: bool, as_json: bool) -> None:
    """Validate a run, print its configuration or the machine, and its warnings."""
    if out is not None and not machine:
        message = "nothing is written without --machine"
        raise InputError(message, key="--out", allowed="--machine, or no --out")
    configuration = load_run(run)
    robot = robot_from(configuration.robot)
    refuse_unfit(configuration)
    pairs = [(i + 1, j + 1) for i, j in configuration.robot.shared_joint_pairs]
    done = [stage.name for stage in performed_stages(configuration)]
    warnings = list(configuration.warnings)
    open_limits, defaults = open_rows(configuration.robot), defaults_in_words(configuration.robot)
    held, reserve = held_in_words(configuration.robot), reserve_in_words(configuration.robot)
    if open_limits:
        warnings.append(f"{open_in_words(open_limits)}: a design may go there as far as it gets")
    warnings += _noise_not_stated(configuration.robot)
    if missing := missing_design(configuration, run_folder(configuration, None)):
        warnings.append(f"expdesign run refuses this file. {missing.message}")
    about = configuration.robot
    made = bodies_in_words(
        about.description.bodies, about.platform_joints, about.description.parameters
    )
    found: dict[str, Any] = {}
    if machine:
        from expdesign.cli.machine import show_machine

        found = show_machine(configuration, robot, run_folder(configuration, out), quiet=as_json)
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
    for stage in named_stages(configuration):
        if reason := stage.reason_left_out(configuration):
            note(f"{stage.name}: left out, {reason}")
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
    """Return the constants of terms that an estimate determines, with their initial values."""
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
    """Return the number of designs of a sweep and their values; nothing without a sweep."""
    lists = [
        f"{path} {' | '.join(value_text(value) for value in values)}"
        for path, values in (configuration.run.sweep or {}).items()
    ]
    count = len(configuration.grid)
    designs = f"{count} design{'' if count == 1 else 's'}"
    return [f"the sweep makes {designs}: {', '.join(lists)}"] if lists else []


def _noise_not_stated(robot: ResolvedRobot) -> list[str]:

    if robot.noise is not None and robot.noise.force_covariance is not None:
        return []
    return [
        "the noise of the forces is not stated (noise.force_std), and a design needs it: "
        f"{NOISE_FROM_DATA}"
    ]
