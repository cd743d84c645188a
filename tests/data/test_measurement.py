"""A recording made of arrays is one that was read from a file with the same numbers."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest

import expdesign
from expdesign import InputError, Measurement, load_measurement, load_robot

RUN = {"name": "n", "robot": "palida"}
COUNT = 60


@pytest.fixture(scope="module")
def columns():
    rng = np.random.default_rng(0)
    robot = load_robot("palida")
    time = 1.7e9 + np.arange(COUNT) / 250 + 1e-6 * rng.normal(size=COUNT)
    pose = robot.home + 0.01 * rng.normal(size=(COUNT, 6))
    return time, robot.inverse_kinematics(pose), rng.normal(size=(COUNT, 6))


def written(folder, time, lengths, forces, **more):
    file = folder / "recording.csv"
    values = dict(zip([f"q{k}" for k in range(1, 7)], lengths.T, strict=True))
    values |= zip([f"Q{k}" for k in range(1, 7)], forces.T, strict=True)
    exact = [str(Decimal(one)) for one in time]  # all digits of the doubles
    pd.DataFrame({"t": exact, **values, **more}).to_csv(file, index=False)
    return file


def same(made, read):
    for name in ("time", "lengths", "forces", "period"):
        np.testing.assert_array_equal(getattr(made, name), getattr(read, name))
    for name in ("step", "jitter", "lost", "stamped", "warnings"):
        assert getattr(made, name) == getattr(read, name), name


@pytest.mark.parametrize("kept", [range(COUNT), [k for k in range(COUNT) if k not in (20, 21, 40)]])
@pytest.mark.parametrize("stamped", [False, True])
def test_arrays_are_read_as_a_file_is(columns, tmp_path, kept, stamped):
    time, lengths, forces = (part[list(kept)] for part in columns)
    period = 1 + np.arange(len(time)) // 20
    made = Measurement(time, lengths, forces, stamped=stamped, period=period)
    file = written(tmp_path, time, lengths, forces, period=period)
    run = {**RUN, "data": {"time": "stamped" if stamped else "uniform"}}
    read = load_measurement(run, file)
    assert made.lost == COUNT - len(time)
    assert made.step == pytest.approx(1 / 250, rel=1e-4)
    # Rows count from one here; in the file they are lines behind the header.
    same(replace(made, warnings=()), replace(read, warnings=()))
    assert len(made.warnings) == len(read.warnings) == (made.lost > 0)
    # Its time base stays with other forces.
    changed = replace(made, forces=made.forces + 1)
    same(replace(changed, forces=made.forces), made)


def test_a_step_that_is_given_is_taken(columns):
    time, lengths, forces = columns
    made = Measurement(time.tolist(), lengths.tolist(), forces.tolist(), 0.004)
    assert made.step == 0.004
    np.testing.assert_array_equal(made.time, time)
    np.testing.assert_array_equal(made.lengths, lengths)


def test_what_a_file_must_not_have(columns):
    time, lengths, forces = columns

    def refused(**changes):
        values = {"time": time, "lengths": lengths, "forces": forces, **changes}
        with pytest.raises(InputError) as error:
            Measurement(**values)
        return error.value.problems[0]

    late = time.copy()
    late[7] += 0.001
    assert "data.time: stamped" in refused(time=late).allowed
    assert Measurement(late, lengths, forces, stamped=True).jitter > 0.1
    back = time.copy()
    back[5] = back[4]
    assert refused(time=back).key == "t, sample 6"
    broken = lengths.copy()
    broken[2, 3] = np.nan
    assert refused(lengths=broken).key == "q4, sample 3"
    infinite = time.copy()
    infinite[-1] = np.inf
    assert refused(time=infinite).key == f"t, sample {COUNT}"
    assert refused(period=np.arange(COUNT) / 2).key == "period, sample 2"
    assert "rows" in refused(time=time[:2], lengths=lengths[:2], forces=forces[:2]).message


@pytest.mark.parametrize(
    "changes",
    [
        {"lengths": np.zeros((COUNT, 5))},
        {"forces": np.zeros((6, COUNT))},
        {"time": np.ones((1, 2))},
    ],
)
def test_shapes_that_do_not_fit(columns, changes):
    values = dict(zip(("time", "lengths", "forces"), columns, strict=True))
    with pytest.raises(ValueError, match="expected"):
        Measurement(**(values | changes))


def test_numbers_only(columns):
    time, lengths, forces = columns
    with pytest.raises(ValueError, match="forces: expected numbers"):
        Measurement(time, lengths, forces.astype(str))


def test_the_section_of_the_run_says_how_it_is_read(columns, tmp_path):
    time, lengths, forces = columns
    file = written(tmp_path, time, 1e3 * lengths, forces)
    data = {"file": str(file), "units": {"q": "mm"}, "delay": {"forces": "2 ms"}}
    found = load_measurement({**RUN, "data": data})
    np.testing.assert_allclose(found.lengths, lengths, rtol=1e-14)
    assert (found.force_delay, found.source) == (0.002, str(file))
    for function in (load_measurement, expdesign.estimate):
        with pytest.raises(InputError) as error:
            function(RUN)
        assert error.value.problems[0].key == "data.file"
