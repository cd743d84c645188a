"""Recordings of PaLiDA, and the same in every file format."""

from dataclasses import dataclass

import h5py
import numpy as np
import pandas as pd
from asammdf import MDF, Signal
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from expdesign.configuration.estimate import FORCE_CHANNELS, LENGTH_CHANNELS

ROWS = 60
STEP = 1e-3
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS)
STORE = get_typestore(Stores.ROS2_HUMBLE)
EPOCH = 1_700_000_000_000_000_000


@dataclass
class Recording:
    t: np.ndarray
    q: np.ndarray
    Q: np.ndarray

    @property
    def columns(self):
        values = [self.t, *self.q.T, *self.Q.T]
        return dict(zip(CHANNELS, values, strict=True))

    @property
    def frame(self):
        return pd.DataFrame(self.columns)


def recording(rows=ROWS, seed=0):
    t = STEP * np.arange(rows)
    phase = 20 * t[:, None] + np.arange(6)
    noise = np.random.default_rng(seed).standard_normal((rows, 6))
    return Recording(t, 0.7 + 0.1 * np.sin(phase), 80 * np.cos(phase) + 20 * noise)


def write_csv(path, rec):
    rec.frame.to_csv(path, index=False)


def write_mat(path, rec):
    savemat(path, rec.columns)


def write_npz(path, rec):
    np.savez(path, **rec.columns)


def matlab73_file(path):
    """An empty file as MATLAB makes them, with its text before the HDF5 signature."""
    file = h5py.File(path, "w", userblock_size=512)
    file.close()
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116))
    return h5py.File(path, "r+")


def write_mat73(path, rec):
    with matlab73_file(path) as file:
        for name, values in rec.columns.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = b"double"


def write_hdf5(path, rec):
    with h5py.File(path, "w") as file:
        for name, values in rec.columns.items():
            file["recording/" + name] = values


def write_mdf(path, rec, **kwargs):
    with MDF(version="4.10") as file:
        file.append(
            [Signal(v, rec.t, name=name) for name, v in rec.columns.items() if name != "t"],
            **kwargs,
        )
        file.save(path, overwrite=True)


def joint_state(stamp, names, position, effort=()):
    header = STORE.types["std_msgs/msg/Header"](
        stamp=STORE.types["builtin_interfaces/msg/Time"](
            sec=int(stamp // 10**9), nanosec=int(stamp % 10**9)
        ),
        frame_id="",
    )
    return STORE.types["sensor_msgs/msg/JointState"](
        header=header,
        name=list(names),
        position=np.asarray(position, dtype=float),
        velocity=np.zeros(0),
        effort=np.asarray(effort, dtype=float),
    )


def messages_of(rec, names=LENGTH_CHANNELS):
    stamps = EPOCH + np.round(rec.t * 1e9).astype(np.int64)
    return [joint_state(*row) for row in zip(stamps, [names] * len(stamps), rec.q, rec.Q)]  # noqa: B905


def write_bag(folder, topics, plugin=StoragePlugin.MCAP):
    """Write topic → messages; they are logged every millisecond."""
    kind = "sensor_msgs/msg/JointState"
    with Writer(folder, version=9, storage_plugin=plugin) as bag:
        for topic, messages in topics.items():
            connection = bag.add_connection(topic, kind, typestore=STORE)
            for row, message in enumerate(messages):
                log_time = EPOCH + 10**6 * row
                bag.write(connection, log_time, STORE.serialize_cdr(message, kind))


def write_mcap(path, rec):
    folder = path.parent / f"{path.name}.bag"
    write_bag(folder, {"/joint_states": messages_of(rec)})
    next(folder.glob("*.mcap")).rename(path)


def write_db3(path, rec):
    folder = path.parent / f"{path.name}.bag"
    write_bag(folder, {"/joint_states": messages_of(rec)}, StoragePlugin.SQLITE3)
    next(folder.glob("*.db3")).rename(path)


def write_bag_folder(path, rec):
    write_bag(path, {"/joint_states": messages_of(rec)})


WRITERS = {
    "recording.csv": write_csv,
    "recording.mat": write_mat,
    "recording73.mat": write_mat73,
    "recording.npz": write_npz,
    "recording.h5": write_hdf5,
    "recording.mf4": write_mdf,
    "recording.mcap": write_mcap,
    "recording.db3": write_db3,
    "recording": write_bag_folder,
}
