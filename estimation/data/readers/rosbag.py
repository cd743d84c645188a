"""ROS 2 recordings with sensor_msgs/JointState: rosbag2 folders, .mcap and .db3 files."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from estimation.data.formats import FileFormat
from estimation.data.table import (
    FileContent,
    RawTable,
    RecordedColumn,
    pick_columns,
    refuse,
    refuse_long,
)
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    quote,
)

_MESSAGE = "sensor_msgs/msg/JointState"
_FIELDS = ("position", "velocity", "effort")
_STAMP, _LOG_TIME = "header.stamp", "log_time"
_NANOSECOND = 1e-9


def read(path: Path, section: DataSection) -> RawTable:
    """Read the joint states of a topic; time counts from its first message.

    A joint's columns are ``name.position`` and ``name.effort``; with several topics of joint
    states, ``/topic:name.position``. The joint's name alone is its position for q1…q6 and its
    effort for Q1…Q6, and Q_j is the effort of the joint that q_j is the position of, unless
    `columns` says otherwise.

    Raises
    ------
    InputError
        There are no joint states; joints are missing from the topic, or missing from some messages
        or named twice there; or several publishers take turns on the topic.
    """
    with _opened(path) as bag:
        topics = _topics(bag)
        columns = list(_columns(bag, topics))
        if not columns:
            raise InputError(
                f"there are no messages {_MESSAGE} in it", path, allowed="a topic of them"
            )
        names = _joint_names(section.columns, columns)
        picked = pick_columns(columns, names, path, channels=section.channels)
        topics_picked = {column.place[0]: column for column in picked.values()}
        if len(topics_picked) > 1:
            some = " and ".join(f"'{column.label}'" for column in topics_picked.values())
            message = f"the columns are of several topics: {some}"
            raise InputError(message, path, allowed="one topic")
        (topic,) = topics_picked
        refuse_long(sum(connection.msgcount for connection in topics[topic]), path)
        return _table(bag, topics[topic], picked, path)


def list_joints(path: Path) -> FileContent:
    """List the columns of every topic of joint states."""
    with _opened(path) as bag:
        return FileContent(list(_columns(bag, _topics(bag))))


def _opened(path: Path) -> Any:
    """Return the reader of a recording, a context manager."""
    highlevel = import_module("rosbags.highlevel")
    typesys = import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    return highlevel.AnyReader([path], default_typestore=store)


def _topics(bag: Any) -> dict[str, list[Any]]:
    """Return the connections of every topic of joint states."""
    topics: dict[str, list[Any]] = {}
    for connection in bag.connections:
        if connection.msgtype == _MESSAGE:
            topics.setdefault(connection.topic, []).append(connection)
    return topics


def _columns(bag: Any, topics: Mapping[str, list[Any]]) -> Iterator[RecordedColumn]:
    """Yield the columns of every joint that the first message of a topic names."""
    for topic, connections in topics.items():
        prefix = f"{topic}:" if len(topics) > 1 else ""
        first = next(bag.messages(connections=connections), None)
        if first is None:
            continue
        for name in (_STAMP, _LOG_TIME):
            yield RecordedColumn(f"{prefix}{name}", (topic, name), short=name, unit="s")
        message = bag.deserialize(first[2], _MESSAGE)
        for joint in message.name:
            for kind in _FIELDS:
                short = f"{joint}.{kind}"
                yield RecordedColumn(f"{prefix}{short}", (topic, joint, kind), short=short)


def _joint_names(given: Mapping[str, str], columns: list[RecordedColumn]) -> dict[str, str]:
    """Return the names of the columns for names that may be those of joints."""
    known = {spelling for column in columns for spelling in column.spellings}
    names = {channel: given[channel] for channel in ("t", "period") if channel in given}
    for length, force in zip(LENGTH_CHANNELS, FORCE_CHANNELS, strict=True):
        joint = given.get(length, length)
        names[length] = joint if joint in known else f"{joint}.position"
        joint = given.get(force, names[length].removesuffix(".position"))
        names[force] = joint if joint in known else f"{joint}.effort"
    # The prefix of the topic, empty when there is one topic.
    first = (column for column in columns if names[LENGTH_CHANNELS[0]] in column.spellings)
    prefix = next((column.text.removesuffix(column.short) for column in first), "")
    names.setdefault("t", f"{prefix}{_STAMP}")
    return names


def _table(
    bag: Any, connections: list[Any], picked: Mapping[str, RecordedColumn], path: Path
) -> RawTable:
    joints = {channel: c.place[1:] for channel, c in picked.items() if channel != "t"}
    by_log_time = picked["t"].place[1] == _LOG_TIME
    stamps: list[int] = []
    rows = array("d")
    problems: list[Problem] = []
    wanted, kinds = (sorted(set(each)) for each in zip(*joints.values(), strict=True))
    names: list[str] = []
    places: list[tuple[str, int]] = []
    publishers: list[tuple[int, str]] = []
    for number, (source, log_time, data) in enumerate(bag.messages(connections=connections), 1):
        message = bag.deserialize(data, _MESSAGE)
        faults = _wrong_values(message, kinds)
        if message.name != names:
            faults += _wrong_names(message.name, wanted)
        if faults:
            problems += [Problem(text, path, key=f"message {number}") for text in faults]
            names = []
            continue
        if message.name != names:
            names = message.name
            places = [(kind, names.index(joint)) for joint, kind in joints.values()]
        rows.extend([getattr(message, kind)[place] for kind, place in places])
        publishers.append((source.id, message.header.frame_id))
        stamp = message.header.stamp
        stamps.append(log_time if by_log_time else stamp.sec * 1_000_000_000 + stamp.nanosec)
    refuse(problems, path, "messages are like that")
    _refuse_turns(publishers, path)
    if len(stamps) > 1 and not by_log_time and len(set(stamps)) == 1:
        message = "all messages have the same header.stamp: it was not set"
        allowed = f"data.columns: {{t: {_LOG_TIME}}} takes the time at which they were recorded"
        raise InputError(message, path, key=_STAMP, allowed=allowed)
    table = np.array(rows).reshape(-1, len(joints))
    values = {channel: table[:, k].copy() for k, channel in enumerate(joints)}
    values["t"] = np.array([stamp - stamps[0] for stamp in stamps]) * _NANOSECOND
    origin = stamps[0] * _NANOSECOND if stamps else 0.0
    return RawTable(path, values, picked, "message", origin=origin)


def _wrong_names(names: list[str], wanted: list[str]) -> list[str]:
    """Return the faults of a message's names of joints."""
    missing = [joint for joint in wanted if joint not in names]
    twice = [joint for joint in wanted if names.count(joint) > 1]
    faults = (("has no joint", missing), ("names twice", twice))
    return [f"the message {verb} {', '.join(map(quote, found))}" for verb, found in faults if found]


def _wrong_values(message: Any, kinds: list[str]) -> list[str]:
    """Return the faults of a message's numbers of values."""
    counts = {kind: len(getattr(message, kind)) for kind in kinds}
    joints = len(message.name)
    return [
        f"the message has {count} values of {kind} for {joints} joints"
        for kind, count in counts.items()
        if count != joints
    ]


def _refuse_turns(publishers: list[tuple[int, str]], path: Path) -> None:
    """Refuse messages of publishers, by connection and frame, that take turns on one topic."""
    others = [k for k, one in enumerate(publishers) if one != publishers[0]]
    if not others or publishers[others[0] :].count(publishers[0]) == 0:
        return
    (_, frame), (_, other) = publishers[0], publishers[others[0]]
    named = f" (frame_id {quote(other)}, not {quote(frame)})" if other != frame else ""
    message = f"the message is of another publisher{named}: they take turns on the topic"
    allowed = f"one publisher; {len(others)} of {len(publishers)} messages are of others"
    raise InputError(message, path, key=f"message {others[0] + 1}", allowed=allowed)


FORMATS = (
    FileFormat(
        "rosbag2, MCAP",
        (".mcap", ".db3"),
        read,
        "rosbags",
        "ros",
        may_crash=True,
        folder_file="metadata.yaml",
        list_columns=list_joints,
    ),
)
