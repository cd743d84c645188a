"""ROS 2 recordings of sensor_msgs/JointState."""

from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from expdesign.configuration.estimate import LENGTH_CHANNELS
from tests.data.recordings import EPOCH, STORE, messages_of, recording, write_bag

pytestmark = pytest.mark.usefixtures("forked")


@pytest.fixture
def bag(tmp_path):
    """Write topics of messages; one list is that of /joint_states."""

    def write(messages):
        topics = messages if isinstance(messages, dict) else {"/joint_states": messages}
        write_bag(tmp_path / "bag", topics)
        return tmp_path / "bag"

    return write


def test_joints_in_any_order_that_may_change(bag, rec, read):
    messages = messages_of(rec)
    rng = np.random.default_rng(0)
    for row in range(30, 60):
        order = rng.permutation(6)
        messages[row].name = [LENGTH_CHANNELS[j] for j in order]
        messages[row].position = rec.q[row, order]
        messages[row].effort = rec.Q[row, order]
    found = read(bag(messages))
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces, rec.Q)


def test_time_counts_from_the_first_message(bag, rec, read):
    found = read(bag(messages_of(rec)))
    assert found.time == pytest.approx(rec.t, abs=1e-12)
    assert found.jitter < 1e-9


def test_joints_by_name_bring_their_efforts(bag, rec, read):
    names = [f"slider_{j}" for j in "abcdef"]
    path = bag(messages_of(rec, names))
    columns = {f"q{j}": name for j, name in enumerate(names, 1)}
    assert np.array_equal(read(path, columns=columns).forces, rec.Q)
    columns |= {"Q1": "slider_b.effort", "Q2": "slider_a.effort"}
    found = read(path, columns=columns)
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces[:, :3], rec.Q[:, [1, 0, 2]])


def test_stamps_that_jitter(bag, rec, read, refused):
    rec.t = rec.t + 1e-3 * np.round(np.random.default_rng(0).uniform(-0.3, 0.3, 60), 6)
    path = bag(messages_of(rec))
    assert "time is not uniform" in refused(path)[0].message
    found = read(path, time="stamped")
    assert found.time == pytest.approx(rec.t - rec.t[0], abs=1e-9)
    assert found.stamped


def test_a_message_without_a_joint(bag, rec, refused):
    messages = messages_of(rec)
    messages[16].name = [*LENGTH_CHANNELS[:2], "x", *LENGTH_CHANNELS[3:]]
    (problem,) = refused(bag(messages))
    assert (problem.key, problem.message) == ("message 17", "the message has no joint 'q3'")


def test_many_messages_without_a_joint(bag, rec, refused):
    messages = messages_of(rec)
    for message in messages[10:]:
        message.name = [*LENGTH_CHANNELS[:5], "x"]
    problems = refused(bag(messages))
    assert [problem.key for problem in problems] == [*(f"message {k}" for k in range(11, 16)), ""]
    assert problems[-1].message == "45 more messages are like that"


@pytest.mark.parametrize("count", [2, 7])
@pytest.mark.parametrize("field", ["position", "effort"])
def test_a_message_with_too_few_or_too_many_values(field, count, bag, rec, refused):
    messages = messages_of(rec)
    setattr(messages[4], field, np.zeros(count))
    (problem,) = refused(bag(messages))
    assert problem.key == "message 5"
    assert problem.message == f"the message has {count} values of {field} for 6 joints"


@pytest.mark.parametrize("row", [0, 7])
def test_a_joint_that_is_named_twice(row, bag, rec, refused):
    messages = messages_of(rec)
    for message in messages[row : row + 1]:
        message.name = [*LENGTH_CHANNELS, "q3"]
        message.position = np.append(message.position, 0.7)
        message.effort = np.append(message.effort, 0.0)
    problem = refused(bag(messages))[0]
    if row:
        assert (problem.key, problem.message) == ("message 8", "the message names twice 'q3'")
    else:
        assert "2 columns have the name of q3" in problem.message


@pytest.mark.parametrize("frame", ["", "gui"])
def test_a_second_publisher_on_the_topic(frame, bag, rec, refused):
    """Its efforts are zero: in stamped time every other row would halve the forces."""
    others = messages_of(replace(rec, t=rec.t + 4e-4, Q=0 * rec.Q))
    for message in others:
        message.header.frame_id = frame
    mixed = [message for both in zip(messages_of(rec), others, strict=True) for message in both]
    (problem,) = refused(bag(mixed), time="stamped")
    assert problem.key == ("message 2" if frame else "q1.effort, message 2")
    if frame:
        assert "of another publisher (frame_id 'gui', not '')" in problem.message
        assert "60 of 120 messages" in problem.allowed
    else:
        assert problem.message.startswith("all forces are zero here and in 59 other rows")


def test_a_publisher_that_follows_another(bag, rec, read):
    """A controller that was restarted with another frame."""
    messages = messages_of(rec)
    for message in messages[:20]:
        message.header.frame_id = "before"
    assert np.array_equal(read(bag(messages)).forces, rec.Q)


def test_drives_that_begin_and_end_without_force(bag, rec, read):
    rec.Q[:5] = rec.Q[30:33] = rec.Q[-2:] = 0
    assert np.array_equal(read(bag(messages_of(rec))).forces, rec.Q)


def test_a_value_that_is_nan(bag, rec, refused):
    rec.Q[6, 3] = np.nan
    (problem,) = refused(bag(messages_of(rec)))
    assert (problem.key, problem.message) == ("q4.effort, message 7", "NaN")


def test_a_joint_that_is_in_no_message(bag, rec, refused):
    names = [*LENGTH_CHANNELS[:5], "q_6"]
    problems = refused(bag(messages_of(rec, names)))
    assert [problem.key for problem in problems] == ["q6.position", "q6.effort"]
    assert problems[0].nearest == "q_6.position"


def test_messages_out_of_order(bag, rec, refused):
    messages = messages_of(rec)
    messages[20], messages[21] = messages[21], messages[20]
    (problem,) = refused(bag(messages))
    assert problem.key == "header.stamp, message 22"
    assert "time goes back from message 21" in problem.message


def test_a_lost_message(bag, rec, read):
    messages = messages_of(rec)
    del messages[20]
    assert read(bag(messages), time="stamped").lost == 1


def test_many_lost_messages(bag, rec, refused):
    messages = messages_of(rec)
    del messages[20 : 20 + len(messages) // 4]
    (problem,) = refused(bag(messages), time="stamped")
    assert problem.key == "header.stamp, message 21"


def test_stamps_that_were_not_set(bag, rec, read, refused):
    messages = messages_of(rec)
    for message in messages:
        message.header.stamp.sec = message.header.stamp.nanosec = 0
    path = bag(messages)
    (problem,) = refused(path)
    assert problem.key == "header.stamp"
    assert problem.allowed.startswith("data.columns: {t: log_time}")
    assert read(path, columns={"t": "log_time"}).time == pytest.approx(rec.t, abs=1e-12)


def test_one_of_several_topics(bag, rec, read, refused):
    other = recording(seed=1)
    path = bag({"/a": messages_of(other), "/b": messages_of(rec)})
    assert "several columns could be q1" in refused(path)[0].message
    columns = {f"q{j}": f"/b:q{j}" for j in range(1, 7)}
    found = read(path, columns=columns)
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces, rec.Q)
    mixed = {**columns, "q3": "/a:q3"}
    assert "the columns are of several topics" in refused(path, columns=mixed)[0].message


@pytest.mark.parametrize("epoch", [0, -EPOCH + 12_000_000_000])
def test_two_bags_have_one_clock(tmp_path, rec, read, epoch):
    """The second begins 10 samples later, with dates and in simulated time."""
    files, late = {}, 10
    rec.Q = 1e3 * (rec.q - 0.7)
    for group, first in (("lengths", 0), ("forces", late)):
        messages = messages_of(rec)[first:]
        for message in messages:
            message.header.stamp.sec += epoch // 1_000_000_000
        write_bag(tmp_path / group, {"/joint_states": messages})
        files[group] = str(tmp_path / group)
    found = read(tmp_path / "lengths", files=files)
    assert "forces begin 10 ms later" in found.warnings[0]
    rows = np.rint(found.time / 1e-3).astype(int)
    assert late <= len(rec.t) - len(rows) <= late + 1  # dates are rounded to 256 ns
    np.testing.assert_allclose(found.forces, rec.Q[rows], atol=0.01)
    np.testing.assert_allclose(found.lengths, rec.q[rows], rtol=1e-9)


def test_other_messages_are_no_joint_states(tmp_path, refused):
    path = tmp_path / "bag"
    kind = "std_msgs/msg/Float64"
    with Writer(path, version=9) as bag:
        connection = bag.add_connection("/x", kind, typestore=STORE)
        message = STORE.types[kind](data=1.0)
        bag.write(connection, EPOCH, STORE.serialize_cdr(message, kind))
    (problem,) = refused(path)
    assert problem.message == "there are no messages sensor_msgs/msg/JointState in it"


def test_two_thousand_messages(bag, read):
    rec = recording(2000)
    assert np.array_equal(read(bag(messages_of(rec))).lengths, rec.q)
