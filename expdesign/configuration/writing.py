"""The resolved configuration as YAML, for `load_run`."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator
from typing import Any

from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.run import RunConfiguration, stage_keys

_HEADER = """\
# Resolved configuration: every value that is used, with the defaults. Values are in SI units
# (m, s, kg, N, rad; frequencies in Hz). Loading this file gives the same configuration.
"""
_ROBOT_HEADER = """\
# Robot file from an estimate: values in SI units (m, s, kg, N, rad), their covariance under
# `identification`. Name it as `robot:` of a run file.
"""
_UNNAMED = "# Sections that this run does not name, with their defaults:\n"
_EXPERIMENT_IS_USED = (
    "# The design uses periods and sampling of the experiment for the predicted precision.\n"
)
_DESIGNS = "# `expdesign run` designs, with the values of design below, since no stage is named.\n"
_WIDTH = 96
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*")
_WORDS = re.compile(r"[^\s]+(?: [^\s]+)*")
_RESERVED = ("null", "true", "false", "yes", "no", "on", "off")


def resolved_yaml(configuration: RunConfiguration) -> str:
    """Return the complete configuration as YAML text.

    The robot is a mapping, with the run's limits, noise and tolerances. Sections of stages that the
    run does not name, and unused sections of data, are comments: `load_run` of a file with this
    text returns an equal configuration, to the last bit, with the same stages.
    """
    data = configuration.run.model_dump(by_alias=True)
    stages = configuration.run.stages
    unnamed = [stage for stage in stage_keys() if stage not in stages]
    if "data" not in configuration.run.model_fields_set and "estimate" not in stages:
        unnamed.append("data")
    if configuration.run.sweep is not None:
        # Values that follow from swept keys are derived again at every point.
        for section, key in (("trajectory", "controller_period"), ("design", "smoothing")):
            if key not in getattr(configuration.run, section).model_fields_set:
                data[section][key] = None
    # Empty, since they are part of the robot.
    data = {key: data[key] for key in data if key not in ("limits", "noise", "tolerances")}
    parts = [_HEADER]
    for key, value in data.items():
        if key not in unnamed:
            parts += ["\n" if isinstance(value, dict) else "", *yaml_lines(key, value, 0)]
    if unnamed:
        parts += ["\n", _UNNAMED]
        designs = not stages or "design" in stages
        parts += [_DESIGNS] if not stages else []
        parts += [_EXPERIMENT_IS_USED] if designs and "experiment" in unnamed else []
        for key in unnamed:
            parts += [f"# {line}" for line in yaml_lines(key, data[key], 0)]
    return "".join(parts)


def robot_yaml(robot: RobotDescription) -> str:
    """Return the text of a robot's file, exact to the last bit."""
    data = {
        key: value for key, value in robot.model_dump(by_alias=True).items() if value is not None
    }
    lines = (line for key, value in data.items() for line in yaml_lines(key, value, 0))
    return "".join([_ROBOT_HEADER, *lines])


def yaml_lines(key: str, value: Any, indent: int) -> Iterator[str]:
    """Yield the lines of one key of a mapping with an indentation."""
    margin = " " * indent
    name = _text(key)
    if isinstance(value, dict) and value:
        yield f"{margin}{name}:\n"
        for inner, item in value.items():
            yield from yaml_lines(inner, item, indent + 2)
    elif isinstance(value, list | tuple) and any(isinstance(i, dict | list | tuple) for i in value):
        yield f"{margin}{name}:\n"
        for item in value:
            yield f"{margin}  - {_flow(item)}\n"
    elif isinstance(value, str) and len(value) > _WIDTH and _folds(value):
        yield f"{margin}{name}: >-\n"
        width = _WIDTH - indent - 2
        for line in textwrap.wrap(
            value, width, break_long_words=False, break_on_hyphens=False, expand_tabs=False
        ):
            yield f"{margin}  {line}\n"
    else:
        yield f"{margin}{name}: {_flow(value)}\n"


def _folds(text: str) -> bool:
    return text.isprintable() and _WORDS.fullmatch(text) is not None


def _flow(value: Any) -> str:
    """Return a value on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_text(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    return _text(value) if isinstance(value, str) else json.dumps(value)


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _RESERVED:
        return text
    escaped = "".join(_escaped(character) for character in text)
    return f'"{escaped}"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    return character if character.isprintable() else f"\\U{ord(character):08x}"
