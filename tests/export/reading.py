"""The files read without the package's own readers: (times, positions, velocities or None)."""

import re
from importlib import import_module

import numpy as np
import pandas as pd
from ruamel.yaml import YAML
from scipy.io import loadmat

FEED = re.compile(
    r"G1 X(\S+) Y(\S+) Z(\S+) A(\S+) B(\S+) C(\S+) F(\S+)",
)


def xps(path, start):
    table = np.loadtxt(path, delimiter=",")
    times = np.concatenate([[0], np.cumsum(table[:, 0])])
    moved = np.cumsum(np.vstack([start, table[:, 1::2]]), axis=0)
    return times, moved, np.vstack([np.zeros(6), table[:, 2::2]])


def gcode(path, _start):
    moves = np.array(FEED.findall(path.read_text()), dtype=float)
    return planned_times(moves[1:, 6]), moves[:, :6], None


def planned_times(feeds):
    """Return when LinuxCNC's planner ends moves with these F: after whole servo cycles of 1 ms."""
    return np.concatenate([[0], np.cumsum(np.floor(60e3 / feeds))]) / 1e3


def pmac(path, start):
    text = path.read_text()
    times = np.concatenate([[0], np.cumsum(np.array(re.findall(r"^PVT(\S+)$", text, re.M), float))])
    pairs = np.array(re.findall(r"[A-Z]([-\d.]+):([-\d.]+)", text), float).reshape(-1, 6, 2)
    rates = np.vstack([np.zeros(6), pairs[:, :, 1]])
    return times / 1e3, np.vstack([start, pairs[:, :, 0]]), rates


def rows_alone(step):
    def read(path, _start):
        table = np.loadtxt(path, comments="#")
        return step * np.arange(len(table)), table, None

    return read


def galil(step):
    def read(path, start):
        moved = np.array(re.findall(r"^CD (.*)$", path.read_text().split("=0")[0], re.M)[:-1])
        steps = np.array([line.split(",") for line in moved], dtype=float)
        rows = np.cumsum(np.vstack([start, steps]), axis=0)
        return step * np.arange(len(rows)), rows, None

    return read


def zaber(path, _start):
    points = import_module("zaber_motion.ascii").PvtSequence.load_sequence_data(str(path))
    points = points.sequence_data
    assert not any(point.relative for point in points)
    assert "millimetres" in points[0].positions[0].unit.value
    times = np.cumsum([point.time.value for point in points]) / 1e3
    values = [
        np.array([[m.value for m in getattr(point, part)] for point in points])
        for part in ("positions", "velocities")
    ]
    return times, *values


def csv(path, _start):
    table = pd.read_csv(path)
    lengths, rates = (
        table[[f"{name}{j} [{unit}]" for j in range(1, 7)]].to_numpy()
        for name, unit in (("q", "m"), ("dq", "m/s"))
    )
    return table["t [s]"].to_numpy(), lengths, rates


def mat(path, _start):
    command = loadmat(path)["command"]
    return command[:, 0], command[:, 1:], None


def _stamps(points, key):
    return np.array([key(p)[0] + 1e-9 * key(p)[1] for p in points])


def joint_yaml(path, _start):
    points = YAML(typ="safe").load(path.read_text())["points"]
    times = _stamps(points, lambda p: tuple(p["time_from_start"].values()))
    return times, *(np.array([p[k] for p in points]) for k in ("positions", "velocities"))


def joint_bag(path, _start):
    highlevel, typesys = (import_module(f"rosbags.{name}") for name in ("highlevel", "typesys"))
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with highlevel.AnyReader([path], default_typestore=store) as bag:
        ((connection, _, raw),) = bag.messages()
        points = bag.deserialize(raw, connection.msgtype).points
    times = _stamps(points, lambda p: (p.time_from_start.sec, p.time_from_start.nanosec))
    return times, *(np.array([getattr(p, k) for p in points]) for k in ("positions", "velocities"))
