"""MATLAB and HDF5 files: matrices, structs, groups, compound datasets."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from estimation.data.readers import hierarchical
from expdesign.configuration import DataSection
from tests.data.recordings import matlab73_file

pytestmark = pytest.mark.usefixtures("forked")


def _check(table, rec):
    assert np.array_equal(table.values["t"], rec.t)
    for j in range(6):
        assert np.array_equal(table.values[f"q{j + 1}"], rec.q[:, j])
        assert np.array_equal(table.values[f"Q{j + 1}"], rec.Q[:, j])


def _mapped(lengths, forces, time):
    columns = {"t": time}
    for j in range(1, 7):
        columns |= {f"q{j}": lengths.format(j), f"Q{j}": forces.format(j)}
    return DataSection(columns=columns)


@pytest.mark.parametrize("transposed", [False, True])
def test_matrices_with_the_names_of_the_channels(transposed, tmp_path, rec):
    path = tmp_path / "m.mat"
    q = rec.q.T if transposed else rec.q
    savemat(path, {"t": rec.t[:, None], "q": q, "Q": rec.Q, "note": "text", "dt": 0.001})
    _check(hierarchical.read_arrays(path, DataSection()), rec)


def test_columns_of_a_matrix_by_name(tmp_path, rec):
    path = tmp_path / "m.mat"
    savemat(path, {"t": rec.t, "log": np.hstack([rec.q, rec.Q])})
    columns = {f"q{j}": f"log(:,{j})" for j in range(1, 7)}
    columns |= {f"Q{j}": f"log(:,{j + 6})" for j in range(1, 7)}
    _check(hierarchical.read_arrays(path, DataSection(columns=columns)), rec)


def test_struct_with_fields(tmp_path, rec):
    path = tmp_path / "m.mat"
    savemat(path, {"rec": {"info": {"date": "today"}, **rec.columns}})
    table = hierarchical.read_arrays(path, DataSection())
    _check(table, rec)
    assert table.column_name("q2") == "rec.q2"
    _check(hierarchical.read_arrays(path, DataSection(columns={"q2": "rec.q2"})), rec)


def test_structure_with_time(tmp_path, rec):
    """As Simulink's To Workspace makes it: signals with labels, or by number."""
    path = tmp_path / "m.mat"
    signals = np.zeros(2, dtype=[("values", "O"), ("label", "O"), ("dimensions", "O")])
    signals[0] = (rec.q, "laenge", 6.0)
    signals[1] = (rec.Q.T[:, None, :], "kraft", np.array([6.0, 1.0]))  # 6 × 1 × T
    savemat(path, {"out": {"time": rec.t[:, None], "signals": signals}})
    by_label = _mapped("laenge(:,{})", "kraft(:,{})", "out.time")
    _check(hierarchical.read_arrays(path, by_label), rec)
    numbered = "out.signals({}).values(:,{{}})"
    by_number = _mapped(numbered.format(1), numbered.format(2), "time")
    _check(hierarchical.read_arrays(path, by_number), rec)


def test_integers_and_single_precision_are_numbers(tmp_path, rec):
    path = tmp_path / "m.mat"
    columns = rec.columns | {
        "t": np.arange(len(rec.t), dtype=np.int32),
        "q1": rec.q[:, 0].astype(np.float32),
    }
    savemat(path, columns)
    table = hierarchical.read_arrays(path, DataSection())
    assert np.array_equal(table.values["t"], np.arange(len(rec.t)))
    assert table.values["q1"] == pytest.approx(rec.q[:, 0], rel=1e-7)
    assert table.values["q1"].dtype == np.float64


def test_text_and_complex_numbers_are_no_columns(tmp_path, rec, refused):
    path = tmp_path / "m.mat"
    savemat(path, rec.columns | {"q1": rec.q[:, 0] + 0j, "q2": ["a", "b"]})
    assert [problem.key for problem in refused(path)] == ["q1", "q2"]


def test_matlab73_matrices_and_structs(tmp_path, rec):
    path = tmp_path / "m.mat"
    with matlab73_file(path) as file:  # MATLAB's arrays stand transposed in HDF5
        file["rec/t"] = rec.t[None, :]
        file["rec/q"] = rec.q.T
        file["rec/Q"] = rec.Q.T
        file["#refs#/q"] = rec.q.T
        text = file.create_dataset("rec/t1", data=np.full((1, 60), 65, dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    table = hierarchical.read_hdf5(path, DataSection(), separator=".")
    _check(table, rec)
    assert table.column_name("q2") == "rec.q(:,2)"


def test_matlab73_text_is_no_column(tmp_path, rec, refused):
    path = tmp_path / "m.mat"
    with matlab73_file(path) as file:
        for name, values in rec.columns.items():
            file[name] = values[None, :]
        file["q3"].attrs["MATLAB_class"] = np.bytes_("char")
    assert [problem.key for problem in refused(path)] == ["q3"]


def test_hdf5_groups_and_unit_attributes(tmp_path, rec, read):
    path = tmp_path / "m.hdf5"
    with h5py.File(path, "w") as file:
        file["run/time"] = rec.t
        file["run/time"].attrs["unit"] = "s"
        for j in range(1, 7):
            file[f"run/q{j}"] = rec.q[:, j - 1] * 1e3
            file[f"run/q{j}"].attrs["units"] = np.bytes_("mm") if j % 2 else "mm"
            file[f"run/Q{j}"] = rec.Q[:, j - 1]
            file[f"set/q{j}"] = np.zeros(60)
    columns = {f"q{j}": f"run/q{j}" for j in range(1, 7)} | {"t": "time"}
    found = read(path, columns=columns)
    assert found.lengths == pytest.approx(rec.q, rel=1e-14)


def _write(path, columns):
    if path.suffix == ".npz":
        np.savez(path, **columns)
        return
    with h5py.File(path, "w") if path.suffix == ".h5" else matlab73_file(path) as file:
        for name, values in columns.items():
            file[name] = values


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_files_without_a_time_and_with_one_group_each(suffix, tmp_path, rec, read):
    files = {}
    for group, name in (("q", "lengths"), ("Q", "forces")):
        files[name] = str(tmp_path / f"{name}{suffix}")
        own = {channel: rec.columns[channel] for channel in rec.columns if channel[0] == group}
        _write(tmp_path / f"{name}{suffix}", own)
    found = read(files["lengths"], files=files, sampling="1 kHz")
    assert np.array_equal(found.lengths, rec.q)
    assert found.forces == pytest.approx(rec.Q, rel=1e-9, abs=1e-9)
    assert found.step == pytest.approx(1e-3)


def test_hdf5_table(tmp_path, rec):
    path = tmp_path / "m.h5"
    with h5py.File(path, "w") as file:
        file["data/table"] = rec.frame.to_records(index=False)
    table = hierarchical.read_hdf5(path, DataSection())
    _check(table, rec)
    assert table.column_name("Q6") == "data/table/Q6"


def test_links_out_of_the_file_are_not_followed(tmp_path, rec, refused):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        for name, values in rec.columns.items():
            file[name] = values
    path = tmp_path / "m.h5"
    with h5py.File(path, "w") as file:
        for name in rec.columns:
            file[name] = h5py.ExternalLink("other.h5", name)
    assert "the file has none" in refused(path)[0].message
