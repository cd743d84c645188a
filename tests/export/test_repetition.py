"""Tables of many periods: rows of one period are written again, and read back as two of them."""

import re
import shutil
import tracemalloc
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from expdesign.configuration import InputError, export_section, load_run
from expdesign.export.certification import PROVED
from expdesign.export.definition import Rows
from expdesign.export.exporting import export_table, file_name, resolve_settings
from expdesign.export.read_back import TableCheck, read_back
from expdesign.export.table_file import certify_file, read_table_file
from expdesign.stages.registry import performed_stages, stages
from tests.estimation.cases import ROBOT, trajectory
from tests.export import reading
from tests.export.motions import spline_motion_of
from tests.export.written import small_task

PERIODS = 5
STEP = 4e-3
UNIFORM = {"segment": STEP, "tolerance": "1 mm"}
COARSE = {"segment": 50e-3, "tolerance": "1 mm"}
FORMATS = {
    "xps-pvt": (COARSE, reading.xps, 1e3),
    "pmac-pvt": (COARSE, reading.pmac, 1e3),
    "pmac-pvt 1 ms": (COARSE | {"clock": "1 ms"}, reading.pmac, 1e3),
    "pvt-csv": (COARSE, reading.zaber, 1e3),
    "linuxcnc-strut": (UNIFORM, reading.rows_alone(STEP), 1e3),
    "csv": (UNIFORM, reading.csv, 1.0),
    "mat": (UNIFORM, reading.mat, 1e3),
    "ros2": (COARSE, reading.joint_yaml, 1.0),
    "ros2 mcap": (COARSE | {"encoding": "mcap"}, reading.joint_bag, 1.0),
}


def work(periods=PERIODS, samples=200):
    motion = spline_motion_of(ROBOT, trajectory(samples), periods, 0.25)
    return replace(small_task(), motion=motion)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Return a maker of tables with five periods, each made once."""

    @cache
    def make(**options):
        section = export_section(**options)
        return export_table(section, work(), tmp_path_factory.mktemp("table") / file_name(section))

    return make


@pytest.fixture
def table(original, tmp_path):
    """Return a maker of tables with five periods that a test may change."""

    def copy(**options):
        made = original(**options)
        folder = tmp_path / made.path.parent.name
        shutil.copytree(made.path.parent, folder)
        companions = tuple(folder / path.name for path in made.companions)
        return replace(made, path=folder / made.path.name, companions=companions)

    return copy


@pytest.fixture
def exported(table):
    """Return a maker of the tables of `FORMATS` by name."""
    return lambda name: table(format=name.split()[0], **FORMATS[name][0])


@pytest.mark.parametrize("name", FORMATS)
def test_all_periods_are_in_the_file(name, exported):
    made = exported(name)
    _, read, unit = FORMATS[name]
    motion = work().motion
    times, position, _ = read(made.path, unit * ROBOT.inverse_kinematics(ROBOT.home))
    assert made.check.rows == len(times)
    assert made.check.duration == pytest.approx(times[-1], abs=1e-9)
    assert 0 <= times[-1] - motion.duration + 1e-6 <= STEP
    wanted = ROBOT.inverse_kinematics(motion.sample(times).pose)
    np.testing.assert_allclose(position / unit, wanted, rtol=0, atol=1e-8)
    again = read_table_file(made.path, made.settings)
    assert again.executed.rows.repeated == PERIODS - 2
    assert again.periods == PERIODS
    # In the last period, on the twin.
    late = np.linspace(0, PERIODS * trajectory().period, 400, endpoint=False)
    wanted = ROBOT.inverse_kinematics(motion.sample(motion.window[0] + late).pose)
    assert np.abs(again.lengths(late) - wanted).max() <= made.check.position_error * 1.001


def test_the_marked_window_has_all_rows_of_all_periods(exported):
    lines = exported("linuxcnc-strut").path.read_text().splitlines()
    begins, ends = (lines.index(f"# measurement window {word}") for word in ("begins", "ends"))
    assert ends - begins - 1 == round(PERIODS * trajectory().period / STEP)


def test_times_of_single_rows_are_those_of_all_rows():
    times = np.array([0.0, 0.1, 0.25, 0.4, 0.45, 0.6, 0.65, 0.8, 0.85, 1.0])
    rows = Rows(times, np.zeros((len(times), 6)), repeated=3, block=(3, 6))
    every = [*times[:7], *(times[4:7] + 0.25), *(times[4:7] + 0.5), *(times[4:7] + 0.75)]
    every += [*(times[7:] + 0.75)]
    assert rows.count == len(every)
    np.testing.assert_allclose([rows.time_of(number) for number in range(rows.count)], every)
    np.testing.assert_allclose(list(rows.every_time()), every)


@pytest.mark.parametrize("name", ["xps-pvt", "linuxcnc-strut"])
def test_the_check_is_that_of_the_whole_table(name, exported, monkeypatch):
    short = exported(name)
    whole = replace(short.settings.form, repeats=False)
    settings = replace(short.settings, form=whole)
    monkeypatch.setattr("expdesign.export.repetition.PERIODS", 100)
    long = read_back(short.path, settings)
    assert not long.failures
    assert (long.rows, long.duration) == (short.check.rows, pytest.approx(short.check.duration))
    assert long.points > short.check.points
    assert long.position_error == pytest.approx(short.check.position_error, rel=1e-6)
    for one, other in zip(long.limits, short.check.limits, strict=True):
        assert one.violation == pytest.approx(other.violation, abs=1e-6)
    found, other = long.information, short.check.information
    assert found.samples == other.samples
    assert found.log_det_design == pytest.approx(other.log_det_design, abs=1e-9)
    # At samples where a rate is zero, its sign differs between periods.
    assert found.log_det_change == pytest.approx(other.log_det_change, abs=1e-3)


def test_information_is_that_of_samples_at_other_phases_in_every_period(tmp_path, monkeypatch):
    section = export_section(format="linuxcnc-strut", **UNIFORM)
    odd = replace(work(), sampling=1.0007 * work().sampling)
    short = export_table(section, odd, tmp_path / file_name(section))
    settings = replace(short.settings, form=replace(short.settings.form, repeats=False))
    monkeypatch.setattr("expdesign.export.repetition.PERIODS", 100)
    found, other = short.check.information, read_back(short.path, settings).information
    assert found.samples == other.samples
    assert found.log_det_design == pytest.approx(other.log_det_design, abs=1e-9)


@pytest.mark.parametrize("name", ["xps-pvt", "pmac-pvt", "linuxcnc-strut", "ros2", "csv"])
def test_a_period_that_differs_is_seen(name, exported):
    made = exported(name)
    lines = made.path.read_text().splitlines()
    numbered = [k for k, line in enumerate(lines) if sum(c.isdigit() for c in line) > 30]
    k = numbered[int(0.7 * len(numbered))]
    place = lines[k].index(".", len(lines[k]) // 2) + 2
    lines[k] = f"{lines[k][:place]}{(int(lines[k][place]) + 5) % 10}{lines[k][place + 1 :]}"
    made.path.write_text("\n".join(lines) + "\n")
    found = read_back(made.path, made.settings)
    assert found.failures
    assert "apart" in found.failures[0]
    fewer = [*lines[: numbered[0]], *lines[numbered[len(numbered) // 2] :]]
    made.path.write_text("\n".join(fewer) + "\n")
    assert read_back(made.path, made.settings).failures


@pytest.mark.parametrize("name", ["csv", "mat"])
def test_shifted_times_behind_the_periods_are_seen(name, exported):
    made = exported(name)
    assert certify_file(read_table_file(made.path, made.settings)).verdict == PROVED
    if name == "csv":
        head, *lines = made.path.read_text().splitlines()
        for k in range(-30, -1):
            time, _, values = lines[k].partition(",")
            lines[k] = f"{float(time) + (-1) ** k * 0.45e-3!r},{values}"
        made.path.write_text("\n".join([head, *lines]) + "\n")
    else:
        data = {k: v for k, v in loadmat(made.path).items() if not k.startswith("__")}
        shift = 0.45e-3 * (-1.0) ** np.arange(-30, -1)
        data["command"][-30:-1, 0] += shift
        data["motion"]["t"][0, 0][-30:-1, 0] += shift
        savemat(made.path, data)
    found = read_table_file(made.path, made.settings)
    assert found.executed.rows.repeated == PERIODS - 2
    assert certify_file(found).verdict != PROVED
    assert read_back(made.path, made.settings).failures


def test_the_output_is_on_in_all_periods(tmp_path):
    section = export_section(format="xps-pvt", trigger=2, **COARSE)
    made = export_table(section, work(), tmp_path / "t.trj")
    assert not made.check.failures
    np.testing.assert_allclose(made.check.trigger, work().motion.window, atol=0.03)
    events = made.companions[0].read_text()
    made.companions[0].write_text(events.replace("Start, ", "Start, 1", 1))
    assert read_back(made.path, made.settings).failures


def test_times_of_a_pmac_do_not_drift_in_1000_periods(tmp_path):
    """Every time cut to 1/4096 ms, the cubic between; the last period against the design."""
    periods = 1000
    # Its steps are no multiples of 1/4096 ms.
    task = work(periods, samples=231)
    section = export_section(format="pmac-pvt")
    made = export_table(section, task, tmp_path / "t.pmc")
    assert made.check.position_error < made.settings.tolerance
    text = made.path.read_text().splitlines()
    cut = [int(float(line[3:]) * 4096) for line in text if line.startswith("PVT")]
    times = np.concatenate([[0], np.cumsum(cut)]) / 4096e3
    last = slice(int(0.9985 * len(times)), int(0.9995 * len(times)))
    home = 1e3 * ROBOT.inverse_kinematics(ROBOT.home)
    _, position, rate = (part[last] for part in reading.pmac(made.path, home))
    t = times[last]
    middle = (t[1:] + t[:-1]) / 2
    h = np.diff(t)[:, None]
    found = (position[1:] + position[:-1]) / 2 + h * (rate[:-1] - rate[1:]) / 8
    wanted = 1e3 * ROBOT.inverse_kinematics(task.motion.sample(middle).pose)
    assert task.motion.window[0] < middle[0] < task.motion.window[1]
    assert np.abs(found - wanted).max() < 1e3 * made.settings.tolerance
    # A tenth of a microsecond, as before, adds up to far more.
    drift = np.sum(np.floor(np.round(1e3 * np.diff(times), 4) * 4096) / 4096e3) - times[-1]
    speed = np.abs(rate).max() / 1e3
    assert abs(drift) * speed > 10 * made.settings.tolerance


@pytest.mark.slow
def test_memory_does_not_grow_with_the_periods(tmp_path):
    settings = resolve_settings(export_section(format="linuxcnc-strut", **UNIFORM), work(2000))
    from expdesign.export.row_times import designed_rows

    rows = designed_rows(settings)
    assert rows.count > 100_000 > 100 * len(rows.times) / 10
    path = tmp_path / "t.txt"
    tracemalloc.start()
    settings.form.write(path, rows, settings)
    again = settings.form.read(path, settings)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert again.count == rows.count
    assert peak < 20e6


LOOPED = {
    "pmac-pvt": COARSE | {"trigger": 3},
    "pvt-csv": COARSE,
    "linuxcnc-strut": UNIFORM,
    "linuxcnc-gcode": {"trigger": 3},
}
PROGRAMS = {
    "pmac-pvt": (
        r"(.*)Q100=0 WHILE\(Q100<(\d+)\)\n(.*)Q100=Q100\+1 ENDWHILE\n(.*)",
        ("M3==1", "M3==0"),
    ),
    "linuxcnc-gcode": (
        r"(.*)o100 repeat \[(\d+)\]\n(.*)o100 endrepeat\n(.*)",
        ("M62 P3", "M63 P3"),
    ),
}


@pytest.mark.parametrize("name", LOOPED)
def test_a_controller_repeats_the_period(name, table):
    made = table(format=name, repeat="controller", **LOOPED[name])
    whole = table(format=name, **LOOPED[name])
    # What the controller executes, by its own means, is the whole table.
    if name in PROGRAMS:
        loop, (on, off) = PROGRAMS[name]
        head, count, body, tail = re.fullmatch(loop, made.path.read_text(), re.DOTALL).groups()
        program = head + int(count) * body + tail
        assert program.index(on) < program.index(off)
    else:
        lead_in, period, lead_out = (
            (made.path.with_name(f"{name}{part}{made.path.suffix}")).read_text().splitlines()
            for part in (".lead-in", "", ".lead-out")
        )
        first = 1 if name == "pvt-csv" else 0  # the header
        program = "\n".join([*lead_in, *PERIODS * period[first:], *lead_out[first:]])

    def rows(text):
        """Return the lines with numbers of six axes."""
        found = (line for line in text.splitlines() if sum(c.isdigit() for c in line) > 30)
        return [line for line in found if not line.startswith((";", "#"))]

    assert rows(program) == rows(whole.path.read_text())
    assert not made.check.failures
    assert made.check.rows == whole.check.rows
    assert made.check.trigger == whole.check.trigger
    for key in (one.name for one in fields(TableCheck) if "error" in one.name):
        assert getattr(made.check, key) == getattr(whole.check, key)
    assert made.check.position_time == whole.check.position_time
    assert made.path.stat().st_size < 0.4 * whole.path.stat().st_size
    # A changed lead-out is seen.
    for path in (made.path, *(one for one in made.companions if "lead" in one.name)):
        before = path.read_text()
        lines = before.splitlines()
        k = max(k for k, line in enumerate(lines) if rows(line))
        del lines[k]
        path.write_text("\n".join(lines) + "\n")
        assert read_back(made.path, made.settings).failures
        path.write_text(before)
    assert not read_back(made.path, made.settings).failures


def test_two_periods_are_not_repeated_by_a_controller(tmp_path):
    section = export_section(format="pmac-pvt", repeat="controller", **COARSE)
    with pytest.raises(InputError, match="fewer than three"):
        export_table(section, work(2), tmp_path / "t.pmc")
    with pytest.raises(ValueError, match="no option 'repeat'"):
        export_section(format="xps-pvt", repeat="controller")


@pytest.mark.parametrize(
    "name", ["linuxcnc-gcode", pytest.param("pmac-pvt", marks=pytest.mark.slow)]
)
def test_a_controller_repeats_ten_thousand_periods(name, tmp_path):
    section = export_section(format=name, repeat="controller")
    tracemalloc.start()
    made = export_table(section, work(10_000), tmp_path / "t")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not made.check.failures
    assert made.check.rows > 500_000
    assert made.check.information.samples == 10_000 * trajectory().period * small_task().sampling
    assert made.path.stat().st_size < 200_000
    assert peak < 300e6


def test_an_experiment_of_ten_thousand_periods_is_designed_but_not_simulated():
    experiment = {"periods": 10_000, "sampling": "500 Hz"}
    trajectory = {"frequency": ["0.5 Hz", "0.5 Hz"]}
    run = {"name": "n", "robot": "linuxcnc", "trajectory": trajectory, "experiment": experiment}
    configuration = load_run(run | {"design": {}, "export": ["csv"]})
    assert [stage.name for stage in performed_stages(configuration)] == ["design", "export"]
    reason = stages()["experiment"].reason_left_out(configuration)
    assert "1e+07 samples are too many to be simulated" in reason


def test_stages_that_need_a_recording_too_long_to_be_simulated_are_left_out():
    run = {
        "name": "n",
        "robot": "palida",
        # The longest period counts: a design may have it.
        "trajectory": {"frequency": ["0.6 Hz", "5 Hz"]},
        "experiment": {"periods": 10_000},
        "design": {},
        "estimate": {},
        "montecarlo": {"repetitions": 2},
        "validate": [{"motion": "circle"}],
    }
    configuration = load_run(run)
    assert [stage.name for stage in performed_stages(configuration)] == ["design"]
    for name in ("estimate", "montecarlo", "validate"):
        reason = stages()[name].reason_left_out(configuration)
        assert "1.667e+07 samples are too many to be simulated" in reason
    measured = load_run(run | {"data": {"file": "measured.csv"}})
    does = [stage.name for stage in performed_stages(measured)]
    assert does == ["design", "estimate", "validate"]
