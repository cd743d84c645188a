"""Tables made wrong at random, and with harmless changes.

What is wrong is decided here, from the text of the file and the robot's joints with NumPy alone.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from io import StringIO
from itertools import pairwise

import numpy as np
from ruamel.yaml import YAML
from scipy.interpolate import BPoly, CubicHermiteSpline
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation

from expdesign.configuration import InputError, export_section
from expdesign.export.certification import PROVED
from expdesign.export.definition import Task
from expdesign.export.exporting import export_table, file_name
from expdesign.export.result import RECORD, ExportResult, exported_motion, exported_table
from expdesign.export.table_file import certify_file, find_table_file
from expdesign.robot import ForwardKinematicsError, LimitModel, load_robot
from expdesign.trajectory import FourierTrajectory
from tests.export.motions import spline_motion_of

SEED = 39
STEP = 0.02
ROBOTS = {
    "palida": (0.6, [0.06, 0.06, 0.04, 0.2, 0.2, 0.3], 1),
    "linuxcnc": (0.5, [0.08, 0.08, 0.05, 0.15, 0.15, 0.2], 1),
    "dehaeze": (1.0, [0.008, 0.008, 0.005, 0.05, 0.05, 0.05], 3),
}
"""Frequency, Hz, sizes of the coordinates, m and rad, and number of periods."""
RESERVE = 0.25
AWAY, FAST = 5e-5, 1e-3
"""m and m/s: an end that is not at home, or not at rest."""
BEYOND = 2e-3
"""Of a limit's range."""
NUMBER = re.compile(r"[-+]?(?:\d+\.\d+(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)|(?<=PVT)\d+")
GIVEN = {"segment": "20 ms", "tolerance": "3 mm"}


@dataclass(frozen=True)
class Layout:
    """Where a format has its numbers: the indices of those of a row."""

    row: str
    position: slice
    rate: slice | None = None
    acceleration: slice | None = None
    time: str = ""
    unit: float = 1e3
    pose: str = ""
    tail: str = ""
    comment: str = ""
    spaces: tuple[str, str] = ("", "")
    settings: tuple[tuple[str, str], ...] = ()
    """Regular expressions and replacements, each of which makes the file mean something else."""


LAYOUTS = {
    "xps-pvt": Layout(
        r"[-\d]", slice(1, None, 2), slice(2, None, 2), time="seconds", spaces=(", ", " ,  ")
    ),
    "pvt-csv": Layout(
        r"[-\d]",
        slice(1, None, 2),
        slice(2, None, 2),
        time="milliseconds",
        settings=((r"Time \(ms\)", "Time (s)"), (r"\(mm\)", "(cm)"), (r"\(mm/s\)", "(m/s)")),
    ),
    "pmac-pvt": Layout(
        "PVT",
        slice(1, None, 2),
        slice(2, None, 2),
        time="milliseconds",
        tail="CLOSE",
        comment="; checked",
        spaces=(" ", "   "),
        settings=((r"\nABS\n", "\nINC\n"), (r"\nABS\n", "\n"), (r"; start: X", "; start: X1")),
    ),
    "linuxcnc-strut": Layout(
        r"[-\d]",
        slice(0, 6),
        comment="# checked",
        spaces=(" ", " \t "),
        settings=((r"one line every \S+ s", "one line every 0.1 s"), (r"\[mm\]", "[in]")),
    ),
    "pi-wave": Layout(r"[-\d]", slice(0, 6), pose="XYZ", spaces=("\t", " \t ")),
    "linuxcnc-gcode": Layout(
        "G1 ",
        slice(0, 6),
        time="feed",
        pose="xyz",
        tail="M2",
        comment="(checked)",
        spaces=(" ", "  "),
        settings=(
            ("G21", "G20"),
            ("G90", "G91"),
            ("G93", "G94"),
            (r"G64 P\S+", "G64 P5"),
            (r"\nG1 (.*) F\S+", r"\nG1 \1 F6000.0"),
            ("G64 ", "G61 "),
        ),
    ),
    "csv": Layout(
        r"[-\d]",
        slice(0),
        time="absolute",
        unit=1.0,
        settings=((r"q1 \[m\]", "q1 [mm]"), (r"t \[s\]", "t [ms]"), (r"q1 \[m\],q2", "q2 [m],q1")),
    ),
    "mat": Layout(r"[-\d]", slice(1, 7), time="absolute"),
    "ros2": Layout(
        "- ",
        slice(0, 6),
        slice(6, 12),
        slice(12, 18),
        time="stamp",
        unit=1.0,
        comment="# checked",
        settings=(
            ('"strut_1", "strut_2"', '"strut_2", "strut_1"'),
            ("frame_id: base", "frame_id: tool"),
            ("header: \\{", "header: {stamp: {sec: 5, nanosec: 0}, "),
        ),
    ),
}


@cache
def work_of(name):
    """Return the task of a small motion that keeps all limits of a robot with a reserve."""
    robot = load_robot(name)
    frequency, sizes, periods = ROBOTS[name]
    rng = np.random.default_rng(SEED)
    sine, cosine = (np.multiply.outer(sizes, [1, 0.3]) * rng.uniform(-1, 1, (6, 2)) for _ in "sc")
    model, size = LimitModel.of(robot), 1.0
    while True:
        orbit = FourierTrajectory.from_displacements(
            2 * np.pi * frequency, robot.home, size * sine, size * cosine
        )
        motion = spline_motion_of(robot, orbit, periods)
        states = np.hstack(motion.sample(np.linspace(0, motion.duration, 500)))
        if model.violations(states).max() < -RESERVE / 2:
            break
        size *= 0.8
    return Task(name, robot, motion, 1e-3, 200.0, robot.parameter_names)


def options_of(form):
    return {"format": form, **GIVEN, **({"encoding": "yaml"} if form == "ros2" else {})}


class Exported:
    """Exported tables of all formats and robots, each made when it is first asked for."""

    def __init__(self, folder):
        self.folder, self.paths = folder, {}

    def __call__(self, robot, form):
        """Return the path of a table."""
        if (robot, form) not in self.paths:
            self.paths[robot, form] = self._make(robot, form)
        return self.paths[robot, form]

    def _make(self, robot, form):
        work, section = work_of(robot), export_section(**options_of(form))
        path = self.folder / f"{robot}-{form}" / file_name(section)
        made = export_table(section, work, path)
        record = ExportResult(exported_motion(work), {path.name: exported_table(made)})
        record.write_as(path.with_name(RECORD))
        return path


@dataclass(frozen=True)
class Content:
    """The text of a table: lines before its rows, a text for each row, and lines behind."""

    head: str
    rows: tuple[str, ...]
    tail: str
    matrix: dict | None = None

    def numbers(self):
        """Return the numbers of the rows, (N, K)."""
        return np.array([NUMBER.findall(row) for row in self.rows], dtype=float)

    def with_numbers(self, row, values):
        """Return the text of a row with other numbers."""
        found = iter(values)
        return NUMBER.sub(lambda old: _like(old[0], next(found)), self.rows[row])

    def write(self, path):
        if self.matrix is None:
            path.write_text(self.head + "".join(self.rows) + self.tail, encoding="ascii")
            return
        table, data = self.numbers(), dict(self.matrix)
        data["command"] = table[:, :7]
        columns = table[:, 7:].T[:, :, None]
        data["motion"] = dict(zip(data["motion"], columns, strict=True))
        savemat(path, data, appendmat=False, do_compression=data.pop("compressed", False))


def _like(text, value):
    """Return a value with as many digits as a number in the file."""
    if float(text) == value:
        return text
    mantissa, _, exponent = text.lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    return repr(float(value)) if exponent or digits > 12 else f"{value:.{digits}f}"


def content_of(path, form):
    layout = LAYOUTS[form]
    if form == "mat":
        data = {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
        motion = {name: data["motion"][name][0, 0][:, 0] for name in data["motion"].dtype.names}
        units = {name: str(data["units"][name][0, 0].item()) for name in data["units"].dtype.names}
        data |= {"motion": motion, "units": units, "title": str(data["title"].item())}
        table = np.column_stack([data["command"], *motion.values()])
        rows = tuple(" ".join(map(_plain, row)) + "\n" for row in table)
        return Content("", rows, "", data)
    text = path.read_text(encoding="ascii")
    end = text.rindex(layout.tail) if layout.tail else len(text)
    starts = [m.start() for m in re.finditer(f"^{layout.row}", text[:end], re.M)]
    edges = [*starts, end]
    rows = tuple(text[a:b] for a, b in pairwise(edges))
    return Content(text[: starts[0]], rows, text[end:])


def _plain(value):
    text = repr(float(value))
    return text if "." in text or "e" in text else f"{text}.0"


@dataclass(frozen=True)
class TablePath:
    """What the rows say, in SI: times (N,), s, struts (N, 6), m, and what else the format has."""

    times: np.ndarray
    places: np.ndarray
    rates: np.ndarray | None
    accelerations: np.ndarray | None


def path_of(content, form, work):
    """Read a table by the description of its format alone."""
    layout, robot = LAYOUTS[form], work.robot.description
    table = content.numbers()
    position, rate = layout.position, layout.rate
    if form == "csv":
        header = content.head.strip().split(",")
        place = header.index("q1 [m]")
        position = slice(place, place + 6)
    values = table[:, position]
    home = _lengths(robot, np.asarray(work.robot.home)[None, :], "XYZ")
    if form == "xps-pvt":
        values = np.cumsum(np.vstack([home * layout.unit, values]), axis=0)
    elif form == "pmac-pvt":
        values = np.vstack([home * layout.unit, values])
    rates = None if rate is None else table[:, rate] / layout.unit
    if len(values) > len(table):
        rates = np.vstack([np.zeros(6), rates])
    if layout.pose:
        pose = np.hstack([values[:, :3] / layout.unit, np.radians(values[:, 3:])])
        values = np.stack([_lengths(robot, pose, layout.pose)])[0]
    else:
        values = values / layout.unit
    acceleration = layout.acceleration
    accelerations = None if acceleration is None else table[:, acceleration] / layout.unit
    return TablePath(_times(content, layout, table), values, rates, accelerations)


def _times(content, layout, table):
    if layout.time == "absolute":
        return table[:, 0]
    if layout.time == "stamp":
        found = re.findall(r"sec: (\d+), nanosec: (\d+)", "".join(content.rows))
        return np.array(found, dtype=float) @ [1, 1e-9]
    if layout.time == "feed":
        return np.concatenate([[0], np.cumsum(60 / table[1:, 6])])
    if layout.time:
        steps = table[:, 0] / (1e3 if layout.time == "milliseconds" else 1)
        first = [0.0] if steps[0] else []
        return np.cumsum(np.concatenate([first, steps]))
    return STEP * np.arange(len(table))


def _lengths(robot, pose, order):
    turned = Rotation.from_euler(order, pose[:, 3:]).as_matrix()
    joints = pose[:, None, :3] + np.einsum("nij,kj->nki", turned, robot.platform_joints)
    return np.linalg.norm(joints - robot.base_joints, axis=2)


def is_wrong(path, original, work):
    """Tell whether a path is not whole, jumps, or breaks a limit of the struts."""
    home = _lengths(work.robot.description, np.asarray(work.robot.home)[None, :], "XYZ")[0]
    steps, stated = np.diff(path.times), np.diff(original.times)
    if len(steps) == 0 or np.any(steps <= 0) or np.max(steps) > 1.5 * np.max(stated):
        return True
    if np.max(np.abs(path.places[[0, -1]] - home)) > AWAY or abs(path.times[0]) > 1e-6:
        return True
    if abs(path.times[-1] - original.times[-1]) > np.max(stated) / 2:
        return True
    inner = np.linspace(0, 1, 9)
    if path.rates is None:
        slopes = np.diff(path.places, axis=0) / steps[:, None]
        speeds = np.vstack([np.zeros(6), slopes, np.zeros(6)])
        shorter = np.minimum(np.append(steps[:1], steps), np.append(steps, steps[-1:]))
        accelerations = np.diff(speeds, axis=0) / shorter[:, None]
        lengths = path.places
    else:
        if np.max(np.abs(path.rates[[0, -1]])) > FAST:
            return True
        if path.accelerations is None:
            curve = CubicHermiteSpline(path.times, path.places, path.rates)
        else:
            data = np.stack([path.places, path.rates, path.accelerations], axis=1)
            curve = BPoly.from_derivatives(path.times, data)
        times = (path.times[:-1, None] + steps[:, None] * inner * (1 - 1e-9)).ravel()
        lengths, speeds, accelerations = (curve(times, k) for k in range(3))
    for key, values in (
        ("strut_length", lengths),
        ("strut_speed", speeds),
        ("strut_acceleration", accelerations),
    ):
        limit = work.robot.limit(key)
        excess = np.maximum(values - limit.upper, limit.lower - values) / limit.range
        if np.max(excess) > BEYOND:
            return True
    return False


def further_columns_differ(content, original, form):
    """Tell whether columns that are no part of the path differ from the exported ones."""
    if form not in ("csv", "mat") or len(content.rows) != len(original.rows):
        return False
    found, wanted = content.numbers(), original.numbers()
    allowed = 1e-5 * np.maximum(1, np.abs(wanted).max(axis=0))
    differs = np.any(np.abs(found - wanted) > allowed, axis=0)
    if form == "mat":
        return bool(np.any(differs[7:]))
    place = original.head.strip().split(",").index("q1 [m]")
    return bool(np.any(np.delete(differs, slice(place, place + 6))))


def _cut_begin(content, rng, _form):
    count = rng.integers(1, len(content.rows) - 3)
    return replace(content, rows=content.rows[count:])


def _cut_end(content, rng, _form):
    count = rng.integers(1, len(content.rows) - 3)
    return replace(content, rows=content.rows[:-count])


def _hole(content, rng, _form):
    count = int(rng.integers(1, len(content.rows) // 4))
    place = int(rng.integers(1, len(content.rows) - count - 1))
    return replace(content, rows=content.rows[:place] + content.rows[place + count :])


def _period(content, rng, _form):
    """Leave out or repeat a period of `dehaeze`: the seam is smooth."""
    count, place = round(1 / ROBOTS["dehaeze"][0] / STEP), int(rng.integers(25, 60))
    again = content.rows[place : place + 2 * count] if rng.uniform() < 0.5 else ()
    return replace(content, rows=content.rows[:place] + again + content.rows[place + count :])


def _doubled(content, rng, _form):
    count = int(rng.integers(1, 20))
    place = int(rng.integers(1, len(content.rows) - count - 1))
    again = content.rows[place : place + count]
    return replace(content, rows=content.rows[:place] + again + content.rows[place:])


def _swapped(content, rng, _form):
    rows = list(content.rows)
    i, j = rng.choice(len(rows), 2, replace=False)
    rows[i], rows[j] = rows[j], rows[i]
    return replace(content, rows=tuple(rows))


def _shifted(content, rng, _form):
    table = content.numbers()
    column, by = rng.integers(table.shape[1]), rng.integers(1, 40)
    table[:, column] = np.roll(table[:, column], by)
    return _with_table(content, table)


def _column(content, rng, _form):
    table = content.numbers()
    column = rng.integers(table.shape[1])
    first = int(rng.integers(len(table)))
    last = int(rng.integers(first + 1, len(table) + 1))
    size = max(np.abs(table[:, column]).max(), 1e-3)
    table[first:last, column] += size * 10 ** rng.uniform(-5, 0.5) * rng.choice([-1, 1])
    return _with_table(content, table)


def _time(content, rng, form):
    layout = LAYOUTS[form]
    row = int(rng.integers(1, len(content.rows)))
    share = 1 + rng.choice([-0.9, -0.5, -0.1, 0.1, 1.0, 9.0])
    if layout.time == "stamp":
        rows = list(content.rows)
        later = lambda old: f"nanosec: {int(int(old[1]) * share) % 10**9}"  # noqa: E731
        rows[row] = re.sub(r"nanosec: (\d+)", later, rows[row])
        return replace(content, rows=tuple(rows))
    if not layout.time:
        return None
    table = content.numbers()
    column = 6 if layout.time == "feed" else 0
    table[row if rng.uniform() < 0.7 else slice(row, None), column] *= share
    return _with_table(content, table)


def _digits(content, rng, _form):
    digits = rng.integers(0, 4)
    return _with_table(content, np.round(content.numbers(), digits))


def _units(content, rng, form):
    table, layout = content.numbers(), LAYOUTS[form]
    factor = rng.choice([25.4, 1 / 25.4, 1e3, 1e-3, np.pi / 180])
    position = slice(6) if form == "csv" else layout.position
    table[:, position] *= factor
    return _with_table(content, table)


def _setting(content, rng, form):
    if form == "mat":
        data = dict(content.matrix)
        kind = rng.integers(3)
        if kind == 0:
            data["window"] = data["window"] + 0.1
        elif kind == 1:
            data["units"] = data["units"] | {"x": "mm"}
        else:
            data["command_units"] = data["command_units"][::-1]
        return replace(content, matrix=data)
    settings = LAYOUTS[form].settings
    if not settings:
        return None
    old, new = settings[rng.integers(len(settings))]
    body = content.head + content.rows[0]
    changed, count = re.subn(old, new, body, count=1)
    if not count:
        raise ValueError(f"{form}: no setting {old}")
    return replace(content, head=changed, rows=("", *content.rows[1:]))


def _with_table(content, table):
    rows = tuple(content.with_numbers(k, values) for k, values in enumerate(table))
    return replace(content, rows=rows)


FAULTS = {
    "cut at the begin": _cut_begin,
    "cut at the end": _cut_end,
    "hole": _hole,
    "another number of periods": _period,
    "doubled rows": _doubled,
    "swapped rows": _swapped,
    "shifted column": _shifted,
    "changed column": _column,
    "changed time": _time,
    "changed setting": _setting,
    "cut digits": _digits,
    "other units": _units,
}


def _line_ends(content, _rng, _form):
    return replace(
        content,
        head=content.head.replace("\n", "\r\n"),
        rows=tuple(row.replace("\n", "\r\n") for row in content.rows),
        tail=content.tail.replace("\n", "\r\n"),
    )


def _more_digits(content, rng, _form):
    zeros = "0" * int(rng.integers(1, 5))
    more = lambda old: old[0] + zeros if "." in old[0] and "e" not in old[0] else old[0]  # noqa: E731
    return replace(content, rows=tuple(NUMBER.sub(more, row) for row in content.rows))


def _comments(content, rng, form):
    comment = LAYOUTS[form].comment
    if not comment:
        return None
    rows = list(content.rows)
    for place in rng.integers(0, len(rows), 3):
        rows[place] = rows[place] + comment + "\n"
    return replace(content, rows=tuple(rows), head=f"{comment}\n{content.head}")


def _reformatted(content, _rng, form):
    if form == "mat":
        data = content.matrix | {"compressed": True, "note": "checked"}
        return replace(content, matrix=data)
    if form == "ros2":
        data = YAML(typ="safe").load(content.head + "".join(content.rows))
        stream = StringIO()
        dumper = YAML()
        dumper.default_flow_style = False
        dumper.dump(data, stream)
        return Content(stream.getvalue(), (), "")
    old, new = LAYOUTS[form].spaces
    if not old:
        return None
    return replace(content, rows=tuple(row.replace(old, new) for row in content.rows))


HARMLESS = {
    "line ends": _line_ends,
    "more digits": _more_digits,
    "comments": _comments,
    "other format": _reformatted,
}


def is_proved(path, work):
    """Tell whether a file is called proved, as `expdesign certify` does."""
    try:
        table = find_table_file(path, work.robot, work.motion.trajectory)
        return certify_file(table).verdict == PROVED
    except (InputError, ForwardKinematicsError, np.linalg.LinAlgError):
        return False


def draw(exported, count, kinds, seed):
    """Yield tables of all formats and robots in turn, each with a change at random."""
    rng = np.random.default_rng(seed)
    cases = [(robot, form) for form in LAYOUTS for robot in ROBOTS]
    if count < 100:
        cases = [(list(ROBOTS)[k % 3], form) for k, form in enumerate(LAYOUTS)]
    made = 0
    while made < count:
        robot, form = cases[made % len(cases)]
        name = list(kinds)[rng.integers(len(kinds))]
        path, work = exported(robot, form), work_of(robot)
        original = content_of(path, form)
        changed = kinds[name](original, rng, form)
        if changed is None:
            continue
        made += 1
        yield f"{made}: {robot} {form}, {name}", path, work, form, original, changed, name


def certified_copy(path, changed, work):
    """Return whether the table with a changed content is called proved; the file is kept."""
    before = path.read_bytes()
    try:
        changed.write(path)
        return is_proved(path, work)
    finally:
        path.write_bytes(before)


def missed_tables(exported, count, seed=SEED):
    """Return wrong tables that are called proved, and how many are wrong and how many proved."""
    missed, wrong, proved = [], 0, 0
    for case, path, work, form, original, changed, name in draw(exported, count, FAULTS, seed):
        found = certified_copy(path, changed, work)
        proved += found
        bad = name == "changed setting" or further_columns_differ(changed, original, form)
        if not bad:
            path_before, path_now = (path_of(one, form, work) for one in (original, changed))
            bad = is_wrong(path_now, path_before, work)
        wrong += bad
        if found and bad:
            missed.append(case)
    return missed, wrong, proved


def refused_tables(exported, count, seed=SEED):
    """Return tables with a harmless change that are not called proved."""
    return [
        case
        for case, path, work, _, _, changed, _ in draw(exported, count, HARMLESS, seed)
        if not certified_copy(path, changed, work)
    ]
