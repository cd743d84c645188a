"""Several runs from one file: the points of a sweep, and the motions of one experiment."""

from __future__ import annotations

import copy
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from constraints import Limit, limit_definitions
from expdesign.configuration.design import EFFORT, FREQUENCY, LIMITS, Effort, is_scale
from expdesign.configuration.document import Document
from expdesign.configuration.errors import InputError, Key, Problem
from expdesign.configuration.limits import LIFTED, limits_as_written
from expdesign.configuration.quantity import NUMBER
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import GridPoint, RunConfiguration
from expdesign.configuration.schema import LONGEST_NAME

SWEEP = "sweep"
_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")
_DIGEST = 8
Sweep = Mapping[str, Sequence[Any]]
Place = tuple[int, ...]
"""Index of the point's value for every path."""
MOTION = "motion-"
"""Beginning of the names of the motions' run folders."""


def grid_points(
    sweep: Sweep,
    robot: ResolvedRobot,
    document: Document,
    load: Callable[[Document], RunConfiguration],
) -> tuple[GridPoint, ...]:
    """Return the runs of a grid, the last path's values changing first.

    The robot has the run's limits before the sweep, as the base of scale factors; `load` converts a
    document to a complete configuration. Each problem of a point is located in the sweep.
    """
    run = str(document.data.get("name", ""))
    places = list(product(*(range(len(values)) for values in sweep.values())))
    every = [dict(zip(sweep, values, strict=True)) for values in product(*sweep.values())]
    found: list[GridPoint] = []
    wrong: dict[Problem, list[Place]] = {}
    for place, values, name in zip(places, every, _names(every, run), strict=True):
        try:
            configuration = load(_with_values(document, robot, values, name))
        except InputError as error:
            for problem in error.problems:
                wrong.setdefault(replace(problem, line=None, file=None), []).append(place)
        else:
            found.append(GridPoint(values, name.removeprefix(f"{run}-"), configuration))
    if wrong:
        raise InputError(
            located
            for problem, failing in wrong.items()
            for located in _locate(problem, failing, places, sweep, document)
        )
    return tuple(found)


def resolved_cell(path: str, point: GridPoint) -> str:
    """Return the resolved value at a path of a point, SI, as one cell of a table.

    Numbers and words are plain, other values JSON.
    """
    section, *keys = path.split(".")
    run = point.configuration.run
    if is_scale(path):
        value: Any = NUMBER.parse(point.values[path])
    elif section == LIMITS:
        value = point.configuration.robot.description.limits
        for key in keys:
            # A limit that is lifted as a whole has no components; no reserve means zero.
            value = value.get(key, 0.0) if isinstance(value, dict) else value
    else:
        value = run.model_dump(mode="json")[section][keys[0]]
    if path == FREQUENCY and value[0] == value[1]:
        value = value[0]
    return value if isinstance(value, str) else json.dumps(value)


def _with_values(
    document: Document, robot: ResolvedRobot, values: Mapping[str, Any], name: str
) -> Document:
    """Return a run file with values at their key paths, and without the sweep."""
    data = {key: value for key, value in document.data.items() if key != SWEEP}
    # Every point is designed.
    data |= {"name": name, "design": data.get("design") or {}}
    for path, value in values.items():
        section, *keys = path.split(".")
        data[section] = copy.deepcopy(data.get(section) or {})
        if is_scale(path):
            data[section][keys[0]] = _scaled(robot, keys[0], NUMBER.parse(value), path)
            continue
        if path == EFFORT:
            # Starts and hops of the file, such as those that a resolved run states, are another's.
            for key in Effort._fields:
                if f"{section}.{key}" not in values:
                    data[section].pop(key, None)
        place = data[section]
        if len(keys) > 1:
            place = place.setdefault(keys[0], {})
            if place == LIFTED:
                lifted = dict.fromkeys(limit_definitions()[keys[0]].components, LIFTED)
                place = data[section][keys[0]] = lifted
        one = path == FREQUENCY and not isinstance(value, list | tuple)
        place[keys[-1]] = [value, value] if one else value
    return replace(document, data=data)


def _scaled(robot: ResolvedRobot, key: str, factor: float, path: str) -> Any:
    """Return a limit with bounds that are wider by a factor, in the notation of a file.

    A one-sided bound is multiplied by the factor; a range is scaled about its middle.
    """
    limit = robot.limits.get(key)
    if limit is None:
        raise InputError(f"there is no limit {key} to scale", key=path)
    lower, upper = limit.stated_bounds
    both = np.isfinite(lower) & np.isfinite(upper)
    middle = np.where(both, np.where(both, lower, 0) + np.where(both, upper, 0), 0) / 2
    lower, upper = (middle + factor * (side - middle) for side in (lower, upper))
    scaled = Limit(limit.definition, lower, upper, limit.labels, limit.origin)
    return limits_as_written({key: scaled}, robot.characteristic_length)[key]


def _names(points: Sequence[Mapping[str, Any]], run: str) -> list[str]:
    """Return a name for every point from its values, independent of the rest of the grid."""
    names = [
        "-".join([run, *(f"{short_path(path)}-{_slug(value)}" for path, value in values.items())])
        for values in points
    ]
    for number, (name, values) in enumerate(zip(names, points, strict=True)):
        if len(name) > LONGEST_NAME or names.count(name) > 1:
            text = json.dumps([list(values), list(values.values())], default=repr)
            digest = hashlib.sha256(text.encode()).hexdigest()[:_DIGEST]
            names[number] = f"{name[: LONGEST_NAME - _DIGEST - 1]}-{digest}"
    return names


def short_path(path: str) -> str:
    """Return a path without its section.

    Examples
    --------
    >>> short_path("trajectory.harmonics")
    'harmonics'
    """
    return path.partition(".")[2]


def value_text(value: Any) -> str:
    """Return a value of a grid in the notation of the run file."""
    if isinstance(value, list | tuple):
        return " … ".join(map(value_text, value))
    if isinstance(value, dict):
        return ", ".join(f"{key} {value_text(item)}" for key, item in value.items())
    return str(value)


def _slug(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "-".join(map(_slug, value))
    if isinstance(value, dict):
        return "-".join(f"{key}-{_slug(item)}" for key, item in value.items())
    return _UNSAFE.sub("_", str(value).replace(" ", "").replace("%", "pct"))


def _locate(
    problem: Problem,
    failing: Sequence[Place],
    places: Sequence[Place],
    sweep: Sweep,
    document: Document,
) -> Iterator[Problem]:
    """Yield a problem at each value that causes it, or once for a combination of several."""
    paths = list(sweep)
    bad = set(failing)
    causes = [
        (axis, k)
        for axis, path in enumerate(paths)
        for k in range(len(sweep[path]))
        if all(place in bad for place in places if place[axis] == k)
    ]
    at_key = [
        (axis, k)
        for axis, k in causes
        if f"{problem.key}.".replace("[", ".").startswith(f"{paths[axis]}.")
    ]
    section = problem.key.partition(".")[0]
    near = [(axis, k) for axis, k in causes if paths[axis].partition(".")[0] == section]
    reported = at_key or near or causes
    if not reported:
        place = failing[0]
        each = ((path, sweep[path][k]) for path, k in zip(paths, place, strict=True))
        words = ", ".join(f"{path} {value_text(value)}" for path, value in each)
        text = f"with {words}: {_with_key(problem)}"
        yield document.problem((SWEEP,), text, problem.allowed, problem.nearest)
    for axis, k in reported:
        key: Key = (SWEEP, paths[axis], k)
        text = problem.message if at_key else _with_key(problem)
        yield document.problem(key, text, problem.allowed, problem.nearest)


def _with_key(problem: Problem) -> str:
    return f"{problem.key}: {problem.message}" if problem.key else problem.message


def motion_folders(configuration: RunConfiguration, folder: Path) -> tuple[Path, ...]:
    """Return the run folders of a run's motions; the run's own for a single motion."""
    count = configuration.run.trajectory.count
    if count == 1:
        return (folder,)
    return tuple(folder / f"{MOTION}{number}" for number in range(1, count + 1))


def motion_runs(configuration: RunConfiguration, folder: Path) -> list[RunConfiguration]:
    """Return the runs of the single motions of a run in a folder, each with its share of time.

    The twin's noise differs between them: the first one has the run's seed.
    """
    run, folders = configuration.run, motion_folders(configuration, folder)
    found = []
    for number, own in enumerate(folders):
        suffix = f"-{own.name}"
        each = replace(
            configuration,
            run=run.model_copy(update={"name": run.name[: LONGEST_NAME - len(suffix)] + suffix}),
        )
        for section, changes in (
            ("trajectory", {"count": 1}),
            ("design", {"others": tuple(str(other) for other in folders if other != own)}),
            (
                "experiment",
                {
                    "periods": run.experiment.periods // len(folders),
                    "seed": seed_of(run.experiment.seed, number),
                },
            ),
        ):
            each = each.with_section(section, **changes)
        found.append(each)
    return found


def seed_of(seed: int, number: int) -> int:
    """Return a seed for each number from 0; the first one is the seed itself.

    Examples
    --------
    >>> seed_of(7, 0), seed_of(7, 1) == seed_of(8, 0)
    (7, False)
    """
    return seed if number == 0 else int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
