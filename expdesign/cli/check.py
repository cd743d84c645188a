"""Commands `robots` and `check`: the robots that ship, a validated and complete run."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.table import Table

from constraints import Limit
from estimation.data.reading import read_measurement
from expdesign.cli.output import note, results, warn, write_json
from expdesign.configuration import (
    InputError,
    ResolvedRobot,
    RunConfiguration,
    load_run,
    quantity_text,
    resolved_yaml,
)
from expdesign.configuration.bodies import bodies_in_words
from expdesign.configuration.consistency import refuse_missing_task
from expdesign.configuration.estimate import name_in_run_file
from expdesign.configuration.limits import (
    defaults_in_words,
    held_in_words,
    open_in_words,
    open_rows,
    reserve_in_words,
)
from expdesign.configuration.noise import NOISE_FROM_DATA
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.run import yaml_lines
from expdesign.configuration.several_runs import value_text
from expdesign.library import robot_files
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import estimated_constants
from expdesign.stages.execution import run_folder
from expdesign.stages.registry import missing_design, named_stages, performed_stages
from expdesign.stages.run import refuse_unfit
from expdesign.stages.stage import Sources, StageFailed, Workspace
from results.notation import range_text


def check_run(run: str, out: Path | None, *, machine: bool, as_json: bool) -> None:
    """Validate a run, print its configuration or the machine, and its warnings."""
    if out is not None and not machine:
        message = "nothing is written without --machine"
        raise InputError(message, key="--out", allowed="--machine, or no --out")
    configuration = load_run(run)
    robot = robot_from(configuration.robot)
    refuse_unfit(configuration)
    _refuse_unfit_points(configuration)
    refuse_missing_task(configuration.run, configuration.file)
    pairs = [(i + 1, j + 1) for i, j in configuration.robot.shared_joint_pairs]
    named = named_stages(configuration)
    done = [stage.name for stage in performed_stages(configuration)]
    warnings = list(configuration.warnings)
    limits = configuration.robot.limits
    open_limits = open_rows(limits, configuration.robot.shared_joint_pairs)
    defaults, held = defaults_in_words(limits), held_in_words(limits)
    reserve = reserve_in_words(limits)
    if open_limits:
        warnings.append(f"{open_in_words(open_limits)}: a design may go there as far as it gets")
    noise = configuration.robot.noise
    if noise is None or noise.force_covariance is None:
        warnings.append(
            "the noise of the forces is not stated (noise.force_std), and a design needs it: "
            f"{NOISE_FROM_DATA}"
        )
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
    left_out = {stage.name: stage.reason_left_out(configuration) for stage in named}
    notes = (
        f"expdesign run does: {', '.join(done) or 'nothing'}{unnamed}",
        *(f"{name}: left out, {reason}" for name, reason in left_out.items() if reason),
        *(f"struts {i} and {j} share a joint: left out of the strut clearance" for i, j in pairs),
        _designs_in_words(configuration),
        _parameters_in_words(configuration),
        *defaults,
        *held,
        reserve,
        about.rounded,
        *_constants_in_words(robot),
        made,
    )
    for text in filter(None, notes):
        note(text)
    for warning in warnings:
        warn(warning)


def show_channels(run: str, data: Path, design: Path | None, *, as_json: bool) -> None:
    """Check the channels of a recording, and print the section `data` that is right."""
    configuration = load_run(run)
    refuse_unfit(configuration)
    sources = Sources(data=(data,), designs=() if design is None else (design,))
    work = Workspace(configuration, run_folder(configuration, None), sources=sources)
    recording = read_measurement(data, configuration.run.data, configuration.robot, plausible=False)
    from expdesign.stages.estimate import check_channels_of  # only for a recording that can be read

    found, remarks, failure = check_channels_of(work, recording)
    section = configuration.run.data
    if section.files is None:
        section = section.model_copy(update={"file": str(data)})
    sections = found.sections(section.with_files(partial(name_in_run_file, configuration.file)))
    sure = "certain" if found.sure else "not certain: other channels explain it nearly as well"
    given = f"{100 * (found.as_given or 0.0):.3g} % of the variation of the forces"
    doubt = (
        f"no channels explain the forces: those of the section explain {given}, and noise is "
        f"{100 * found.noise:.3g} %. Do forces and lengths have the same time, and are the design "
        "and the robot file those of the recording?"
    )
    doubts = [doubt] if found.unexplained and not failure else []
    zeros = "" if found.zeros is None else f"{found.zeros.sentence}: {found.zeros.advice}"
    doubts += filter(None, (zeros, found.silent, found.lag, found.force_scale))
    if as_json:
        faults = [{"place": place, "sentence": sentence} for place, sentence in found.faults]
        keys = ("sure", "silent", "lag", "force_scale", "explained", "as_given", "noise")
        channels = {"faults": faults, "zeros": zeros, **{key: getattr(found, key) for key in keys}}
        clock = [found.clock] if found.clock else []
        result = {**sections, "channels": channels, "warnings": [*clock, *remarks, *doubts]}
        if failure:
            raise StageFailed(failure, result)
        write_json({"status": 0, **result})
        return
    for key, each in sections.items():
        typer.echo("".join(yaml_lines(key, each, 0)), nl=False)
    if found.clock:
        warn(f"{found.clock} (certain)")
    for remark in remarks:
        note(remark)
    for warning in [*(f"{sentence} ({sure})" for _, sentence in found.faults), *doubts]:
        warn(warning)
    if failure:
        raise StageFailed(failure)
    if not (found.faults or doubts or found.as_given is None):
        lag = 1e3 * found.least_lag()
        least = f"a delay of less than {lag:.2g} ms, or a mean over less than {2 * lag:.2g} ms,"
        noise, rest = found.noise, found.rest
        explain = f"explain {given}, and noise is {100 * noise:.3g} %"
        if rest > _FAR * noise:
            said = (
                f"no other channels explain the forces better than those of the section, which "
                f"{explain}: {100 * rest:.3g} % stay unexplained, {rest / noise:.2g} times the "
                "noise. Tolerances of the geometry may leave that, and so may parts that have no "
                "model"
            )
            if design is None:
                said += (
                    ", or zeros of several lengths, which only an executed design (--design) shows"
                )
        else:
            said = (
                f"the channels are those of the struts: they {explain}; no other ones explain the "
                "forces better"
            )
        note(
            f"{said}. With what stays unexplained, {least if np.isfinite(lag) else 'a delay'} may "
            "not be found: `tolerances.delay` lets the estimate find smaller ones"
        )


def _constants_in_words(robot: Robot) -> list[str]:
    """Return the constants of terms that an estimate determines, with their initial values."""
    found = []
    for one in estimated_constants(robot):
        prior = f"a prior of ± {quantity_text(one.tolerance, one.unit)} (tolerances.{one.group})"
        term, constant = one.group.split(".")[1:]
        described = next(t for t in robot.description.description.terms if t.name == term)
        value = quantity_text(described.constants[constant].value, one.unit)
        found.append(
            f"{term}.{constant} is estimated from {value} on, with "
            f"{prior if one.tolerance < float('inf') else 'no prior'}"
        )
    return found


def _refuse_unfit_points(configuration: RunConfiguration) -> None:
    """Refuse designs of a sweep that break a limit at home, with their values."""
    problems = []
    for point in configuration.grid:
        try:
            robot_from(point.configuration.robot)
        except InputError as error:
            words = ", ".join(f"{path} {value_text(each)}" for path, each in point.values.items())
            problems += [
                replace(problem, message=f"with {words}: {problem.message}")
                for problem in error.problems
            ]
    if problems:
        raise InputError(problems)


def _designs_in_words(configuration: RunConfiguration) -> str:
    """Return the number of designs of a sweep and their values; empty without a sweep."""
    lists = [
        f"{path} {' | '.join(value_text(value) for value in values)}"
        for path, values in (configuration.run.sweep or {}).items()
    ]
    count = len(configuration.grid)
    designs = f"{count} design{'' if count == 1 else 's'}"
    return f"the sweep makes {designs}: {', '.join(lists)}" if lists else ""


def _parameters_in_words(configuration: RunConfiguration) -> str:
    """Return the meaning of named `design.parameters`; empty without."""
    design = configuration.run.design
    if design.named_parameters is None:
        return ""
    if design.is_change:
        return "design.parameters with design.prior: the criterion judges their change since then"
    return (
        "design.parameters: all others count as known exactly, as by design.known. To judge these "
        "while the others are unknown, as an estimate has them, name them under design.interest"
    )


_FAR = 4.0
"""Ratio of the unexplained share of the forces to the noise that is no chance."""
_WIDEST = 100
"""Characters of a line that is still easy to read."""


def list_robots(*, as_json: bool) -> None:
    """List the robots that ship."""
    found = [load_robot_description(name) for name in robot_files()]
    if as_json:
        write_json([_as_data(robot) for robot in found])
        return
    console = results()
    for position, robot in enumerate(found):
        if position:
            console.print()
        console.print(robot.name, style="bold")
        console.print(_block(robot, min(console.width, _WIDEST)))


def _block(robot: ResolvedRobot, width: int) -> Table:
    block = Table.grid(padding=(0, 2, 0, 0))
    block.width = width
    block.add_column(no_wrap=True)
    block.add_column(overflow="fold")
    limits = "; ".join(_limit(limit) for limit in robot.limits.values())
    rows = {"geometry": _geometry(robot), "limits": limits, "source": robot.description.description}
    for name, text in rows.items():
        block.add_row(f"  {name}", text)
    return block


def _geometry(robot: ResolvedRobot) -> str:
    home = _home(robot)
    shortest, longest = (f"{end(home['strut_length']):.4g}" for end in (min, max))
    length = shortest if shortest == longest else f"{shortest} … {longest}"
    base, platform = (
        float(np.mean(np.hypot(joints[:, 0], joints[:, 1])))
        for joints in (robot.base_joints, robot.platform_joints)
    )
    pose = ", ".join(f"{value:.4g}" for value in robot.home)
    return (
        f"home {pose} (m, rad); struts at home {length} m; base radius {base:.4g} m; "
        f"platform radius {platform:.4g} m; {robot.platform} platform; "
        f"Jacobian condition at home {home['jacobian_condition']:.3g} "
        f"(L = {robot.characteristic_length:g} m)"
    )


def _home(robot: ResolvedRobot) -> dict[str, Any]:
    geometry = robot.struts_at(robot.home)
    return {
        "strut_length": geometry.lengths.tolist(),
        "jacobian_condition": geometry.condition(robot.characteristic_length),
    }


def _limit(limit: Limit) -> str:
    definition = limit.definition
    unit, factor = definition.unit, 1.0
    if unit == "rad":
        unit, factor = "deg", float(np.degrees(1.0))
    suffix = "" if unit == "1" else f" {unit}"
    rows = list(zip(limit.lower * factor, limit.upper * factor, strict=True))
    if definition.pairs:
        # Pairs that share a joint are left out; all others have the same bound.
        rows = [row for row in rows if np.any(np.isfinite(row))]
    if all(row == rows[0] for row in rows):
        return f"{definition.title} {range_text(rows[0])}{suffix}"
    parts = ", ".join(
        f"{label} {range_text(row)}" for label, row in zip(limit.labels, rows, strict=True)
    )
    return f"{definition.title} {parts}{suffix}"


def _as_data(robot: ResolvedRobot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "description": robot.description.description,
        "file": str(robot.source),
        "platform": robot.platform,
        "terms": [term.name for term in robot.terms],
        "home": robot.home.tolist(),
        "base_joints": robot.base_joints.tolist(),
        "platform_joints": robot.platform_joints.tolist(),
        "at_home": _home(robot),
        "characteristic_length": robot.characteristic_length,
        "parameters": dict(robot.parameters),
        "limits": {
            key: {"lower": limit.lower.tolist(), "upper": limit.upper.tolist(), "unit": limit.unit}
            for key, limit in robot.limits.items()
        },
        "warnings": robot.warnings,
    }
