"""The twin executes a controller table instead of the design."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from estimation.twin import Twin
from estimation.twin.experiment import TableMotion
from expdesign.configuration import InputError
from tests.estimation.cases import PERIODS, ROBOT, run, trajectory
from tests.export.reading import xps
from tests.export.written import SAMPLING, small_task, written

EXPERIMENT = {"periods": PERIODS, "sampling": SAMPLING}
COARSE = {"format": "xps-pvt", "segment": "50 ms", "tolerance": "0.2 mm"}
FINE = {"segment": "5 ms", "tolerance": "5 um"}


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """Return a table whose path is visibly not the design: rows 50 ms apart."""
    return written(tmp_path_factory.mktemp("table") / "coarse.trj", **COARSE)


def test_its_lengths_are_those_of_hermite_polynomials(coarse):
    """The controller's manual: each element is the cubic of its displacement and velocities."""
    twin = Twin.of(run(experiment=EXPERIMENT), coarse)
    times, position, rate = xps(coarse.path, 1e3 * ROBOT.inverse_kinematics(ROBOT.home))
    path = CubicHermiteSpline(times, 1e-3 * position, 1e-3 * rate)
    begin, _ = small_task().motion.window
    at = begin + np.arange(PERIODS * 200) / SAMPLING
    np.testing.assert_allclose(twin.lengths, path(at), rtol=0, atol=1e-9)
    # It is the table's path and not the design's.
    design = Twin.of(run(experiment=EXPERIMENT), trajectory())
    off = np.abs(twin.lengths - design.lengths).max()
    assert 5e-6 < off < 2e-4
    assert twin.truth.table.position_error == pytest.approx(off, rel=1e-6)
    # The pose moves as the polynomials do: their derivatives, away from the rows.
    inside = at[:40] - begin + 0.002
    states = TableMotion(coarse, coarse.design, coarse.design).sample(inside)
    struts = ROBOT.strut_motion(states.pose, states.rate, states.acceleration)
    np.testing.assert_allclose(struts.length_rate, path(begin + inside, 1), atol=1e-8)
    np.testing.assert_allclose(struts.length_acceleration, path(begin + inside, 2), atol=1e-6)


def test_the_forces_are_those_of_the_executed_motion(coarse):
    twin = Twin.of(run(experiment=EXPERIMENT), coarse)
    times = twin.grid.times
    states = TableMotion(coarse, coarse.design, coarse.design).sample(times)
    expected = ROBOT.actuator_forces(states.pose, states.rate, states.acceleration)
    np.testing.assert_allclose(twin.forces, expected, atol=1e-9)


@pytest.mark.parametrize(
    "options",
    [
        {"format": "xps-pvt"},
        {"format": "xps-pvt", "space": "pose"} | FINE,
        {"format": "ros2", "segment": "20 ms", "tolerance": "50 um"},
        {"format": "pmac-pvt", "sign": [-1] * 6, "offset": "home", "counts_per_metre": [1e6] * 6}
        | FINE,
        {"format": "linuxcnc-gcode"},
        {"format": "linuxcnc-strut", "segment": "2 ms", "tolerance": "0.1 mm"},
    ],
    ids=lambda options: "-".join(
        str(options[key]) for key in ("format", "space") if key in options
    ),
)
def test_every_table_is_the_design_within_its_tolerance(options, tmp_path):
    table = written(tmp_path / "table", **options)
    twin = Twin.of(run(experiment=EXPERIMENT), table)
    design = Twin.of(run(experiment=EXPERIMENT), trajectory())
    assert np.abs(twin.lengths - design.lengths).max() <= table.settings.tolerance
    smooth = np.abs(twin.forces - design.forces).max(axis=1) < 2.0
    # Dry friction jumps where a strut turns round; elsewhere forces agree as well.
    # The planner of LinuxCNC has ripples of the speed, which move these moments.
    assert np.mean(smooth) > (0.9 if options["format"] == "linuxcnc-gcode" else 0.97)
    # Same noise, whatever is executed.
    np.testing.assert_allclose(
        twin.measurement(3).lengths - twin.lengths,
        design.measurement(3).lengths - design.lengths,
        atol=1e-15,
    )


def test_tracking_error_comes_on_top(coarse):
    more = EXPERIMENT | {"tracking_error": {"position": "1 mm", "angle": "0.1 deg"}}
    with_error = Twin.of(run(experiment=more), coarse).lengths
    without = Twin.of(run(experiment=EXPERIMENT), coarse).lengths
    by_design = (
        Twin.of(run(experiment=more), trajectory()).lengths
        - Twin.of(run(experiment=EXPERIMENT), trajectory()).lengths
    )
    # To first order; the second is the coupling of error and interpolation.
    np.testing.assert_allclose(with_error - without, by_design, atol=2e-6)
    assert np.abs(by_design).max() > 1e-3


def test_fewer_periods_than_the_table_has(coarse):
    first = Twin.of(run(experiment=EXPERIMENT | {"periods": 2}), coarse)
    whole = Twin.of(run(experiment=EXPERIMENT), coarse)
    assert first.lengths.shape == (400, 6)
    np.testing.assert_array_equal(first.lengths, whole.lengths[:400])


def test_a_measurement_can_be_repeated_elsewhere(coarse):
    twin = Twin.of(run(experiment=EXPERIMENT), coarse)
    again = pickle.loads(pickle.dumps(twin))
    np.testing.assert_array_equal(again.measurement(2).forces, twin.measurement(2).forces)


def test_a_phase_moves_the_beginning_of_the_design(coarse):
    """`motion.phase: best` enters the orbit elsewhere: t = 0 is where the window begins."""
    moved = replace(
        coarse, executed=replace(coarse.executed, motion=replace(small_task().motion, phase=0.31))
    )
    expected = trajectory().sample(np.array([0.31, 0.51])).pose
    np.testing.assert_allclose(moved.design.sample(np.array([0.0, 0.2])).pose, expected)


def test_what_cannot_be_executed(coarse):
    with pytest.raises(InputError, match="6 periods are to be measured, and the table"):
        Twin.of(run(experiment=EXPERIMENT | {"periods": 6}), coarse)
    rows = coarse.executed.rows
    half = replace(rows, times=rows.times[:60], position=rows.position[:60], rate=rows.rate[:60])
    short = replace(coarse, executed=replace(coarse.executed, rows=half))
    with pytest.raises(InputError, match="inside the measurement window"):
        Twin.of(run(experiment=EXPERIMENT), short)
    other = replace(small_task().motion, trajectory=trajectory(seed=5))
    stranger = replace(coarse, executed=replace(coarse.executed, motion=other))
    with pytest.raises(InputError, match="does not hold the design"):
        Twin.of(run(experiment=EXPERIMENT), stranger)
    far = replace(rows, position=rows.position + 4e3)
    torn = replace(coarse, executed=replace(coarse.executed, rows=far))
    with pytest.raises(InputError, match="does not hold the design"):
        Twin.of(run(experiment=EXPERIMENT), torn)
