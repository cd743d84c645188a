import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest

import results
from expdesign.experiment import DesignResult
from expdesign.recheck.limit_check import LimitCheck
from expdesign.runfolder import RowTable
from expdesign.solver.phases import PHASE_TITLES
from expdesign.trajectory import FourierTrajectory
from results import design_figures
from results.figures.design import DESIGN_FIGURES, FLOOR
from results.figures.drawing import PAGE_WIDTH, RESOLUTION, STRUT_COLOURS, house_style, save_figures
from results.figures.machine import view_extent as extent
from results.figures.motion import excitation_figure
from results.figures.parameters import precision_figure
from results.views.view import Drawing

KEYS = {definition.key for definition in DESIGN_FIGURES}
STRUTS = range(1, 7)
LIMITS_HEAD = f"{','.join(RowTable('', '', LimitCheck).names)}\n"
COUNTS = {"Parameter", "Index of the eigenvalue", "Iteration of the start"}


def draw(run, key):
    record = DesignResult.read(run.folder)
    definition = next(d for d in DESIGN_FIGURES if d.key == key)
    with house_style():
        return definition.draw(record)


@pytest.fixture(scope="module")
def shown(original):
    """Return the figures of the fake run as they are shown, each drawn once."""

    @cache
    def figure(key):
        found = draw(original, key)
        with house_style():
            found.canvas.draw()
        return found

    return figure


def curves(axes, count):
    return np.column_stack([line.get_ydata() for line in axes.get_lines()[:count]])


def texts(axes):
    return [text.get_text() for text in axes.texts]


def labels(axes):
    names = [name for name in ("x", "y", "z") if hasattr(axes, f"get_{name}label")]
    found = [getattr(axes, f"get_{name}label")() for name in names]
    return [text for text in found if text]


@pytest.mark.slow
def test_files_are_complete(run):
    paths = design_figures(DesignResult.read(run.folder), run.folder)
    folder = run.folder / "figures"
    assert set(paths) == {folder / f"{key}.{end}" for key in KEYS for end in ("png", "svg")}
    assert set(folder.iterdir()) == set(paths)
    for path in paths:
        if path.suffix == ".svg":
            assert ET.parse(path).getroot().tag.endswith("svg")
            assert "<dc:date>" not in path.read_text(encoding="utf-8")
        else:
            data = path.read_bytes()
            assert data.startswith(b"\x89PNG")
            assert int.from_bytes(data[16:20], "big") == PAGE_WIDTH * RESOLUTION


@pytest.mark.parametrize("key", sorted(KEYS))
def test_nothing_is_cut_off_in_the_file(original, key, tmp_path):
    chosen = [d for d in DESIGN_FIGURES if d.key == key]
    (path,) = save_figures(chosen, DesignResult.read(original.folder), tmp_path, formats=["png"])
    picture = mpl.image.imread(path)[..., :3]
    for edge in (picture[:3], picture[-3:], picture[:, :3], picture[:, -3:]):
        assert np.all(edge == 1.0)


def test_same_folder_gives_the_same_bytes_under_any_settings(run, tmp_path):
    record = DesignResult.read(run.folder)
    chosen = [d for d in DESIGN_FIGURES if d.key in ("cardan_angles", "path")]
    first = save_figures(chosen, record, tmp_path / "first")
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 20.0, "svg.fonttype": "none"}):
        second = save_figures(chosen, record, tmp_path / "second")
        assert mpl.rcParams["lines.linewidth"] == 9.0
    assert len(first) == 2 * len(chosen)
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_matplotlib_is_not_loaded_before_a_stage_draws():
    code = "import sys, expdesign.cli.runs; sys.exit('matplotlib' in sys.modules)"
    root = Path(results.__file__).parents[1]
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=root).returncode == 0


@pytest.mark.parametrize("key", sorted(KEYS))
def test_every_axis_has_a_unit(shown, key):
    for axes in shown(key).axes:
        assert labels(axes)
        for label in labels(axes):
            assert label in COUNTS or label.endswith(")"), label


@pytest.mark.parametrize("key", sorted(KEYS))
def test_no_legend_covers_data(shown, key):
    figure = shown(key)
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    for axes in figure.axes:
        inside = axes.patch.get_window_extent()
        if axes.name == "3d":  # its box stands somewhere in the patch
            inside = extent(axes).transformed(figure.transFigure)
        for legend in filter(None, legends):
            assert not legend.get_window_extent().padded(-1).overlaps(inside)


def test_captions_are_sentences():
    assert len(KEYS) == len(DESIGN_FIGURES) == 8
    assert all(definition.caption.endswith(".") for definition in DESIGN_FIGURES)


def test_excitation_in_millimetres_from_home_and_degrees(run):
    above, below = draw(run, "excitation").axes
    pose = run.numbers("trajectory.csv", "x", "y", "z", "phi", "theta", "psi")
    zero, *lines = above.get_lines()
    assert list(zero.get_ydata()) == [0, 0]
    np.testing.assert_array_equal(lines[0].get_xdata(), run.numbers("trajectory.csv", "t")[:, 0])
    shown = np.column_stack([line.get_ydata() for line in lines])
    np.testing.assert_allclose(shown, 1e3 * (pose[:, :3] - [0, 0, -0.654]), rtol=1e-12)
    shown = np.column_stack([line.get_ydata() for line in below.get_lines()[1:]])
    np.testing.assert_allclose(shown, np.rad2deg(pose[:, 3:]), rtol=1e-12)
    assert above.get_ylabel() == "Displacement (mm)"
    assert below.get_ylabel() == "Angle (°)"
    assert [t.get_text() for t in below.get_legend().get_texts()] == [
        r"$\varphi$",
        r"$\theta$",
        r"$\psi$",
    ]


@pytest.mark.parametrize(
    ("figure", "panel", "column", "factor", "bounds"),
    [
        ("struts", 0, "q", 1e3, (450, 950)),
        ("struts", 1, "dq", 1, (-2, 2)),
        ("struts", 2, "ddq", 1, None),
        ("struts", 3, "Q", 1, (-150, 150)),
        ("cardan_angles", 0, "alpha", 180 / np.pi, (-35, 35)),
        ("cardan_angles", 1, "beta", 180 / np.pi, (-65, -5)),
    ],
)
def test_strut_panels(run, figure, panel, column, factor, bounds):
    axes = draw(run, figure).axes[panel]
    expected = factor * run.numbers("trajectory.csv", *(f"{column}{j}" for j in STRUTS))
    np.testing.assert_allclose(curves(axes, 6), expected, rtol=1e-12)
    assert [line.get_color() for line in axes.get_lines()[:6]] == list(STRUT_COLOURS)
    low, high = axes.get_ylim()
    assert low < expected.min()
    assert high > expected.max()
    drawn = [line.get_ydata()[0] for line in axes.get_lines()[6:]]
    if bounds is None:  # far away: told beside the title
        assert drawn == []
        assert axes.get_title(loc="right") == "limits ±30 m/s² not in view"
    else:
        np.testing.assert_allclose(drawn, bounds)
        assert low < bounds[0]
        assert high > bounds[1]
        unit = {"q": " mm", "dq": " m/s", "Q": " N"}.get(column, "°")
        assert texts(axes) == [f"limit {bound}{unit}".replace("-", "−") for bound in bounds]


def test_limits_that_differ_from_strut_to_strut(run):
    run.config["limits"] = {
        "strut_length": [[0.45, 0.95], [0.46, 0.9], *([[0.45, 0.95]] * 4)],
        "actuator_force": [150, 150, 150, 100, 150, 150],
    }
    run.write()
    length, _, _, force = draw(run, "struts").axes
    lines = {line.get_ydata()[0]: line for line in length.get_lines()[6:]}
    assert sorted(lines) == pytest.approx([450, 460, 900, 950])
    assert lines[900.0].get_color() == lines[460.0].get_color() == STRUT_COLOURS[1]
    assert texts(length) == ["limits by strut 450 … 460 mm", "limits by strut 900 … 950 mm"]
    assert texts(force) == ["limits by strut −150 … −100 N", "limits by strut 100 … 150 N"]


def test_robot_without_limits(run):
    path = run.folder / "run.yaml"
    lines = path.read_text(encoding="utf-8").splitlines()
    begin = next(k for k, line in enumerate(lines) if line.strip() == "limits:")
    margin = lines[begin].index("limits")
    end = begin + 1
    while lines[end].startswith(" " * (margin + 1)):
        end += 1
    path.write_text("\n".join(lines[:begin] + lines[end:]), encoding="utf-8")
    (run.folder / "tables/limits.csv").write_text(LIMITS_HEAD)
    path = run.folder / "design.json"
    design = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**design, "limits": {}}), encoding="utf-8")
    for axes in draw(run, "struts").axes:
        assert len(axes.get_lines()) == 6
        assert axes.get_title(loc="right") == ""
    assert "this run has no limits" in texts(draw(run, "limits_used").axes[0])
    assert len(draw(run, "path").axes) == 2


def test_path_is_closed_and_to_scale(run):
    robot, alone = draw(run, "path").axes
    path = 1e3 * run.numbers("trajectory.csv", "x", "y", "z")
    closed = np.concatenate([path, path[:1]])
    for axes in (robot, alone):
        found = [np.column_stack(line.get_data_3d()) for line in axes.get_lines()]
        assert any(line.shape == closed.shape and np.allclose(line, closed) for line in found)
        spans = np.diff([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])[:, 0]
        box = axes._box_aspect
        np.testing.assert_allclose(spans / spans[0], box / box[0], rtol=1e-9)


def test_a_path_that_would_be_a_dot_is_drawn_from_home(original, tmp_path):
    small = type(original)(tmp_path / "small")
    small.trajectory = FourierTrajectory.from_displacements(
        2 * np.pi * 0.5,
        [0.001, 0, -0.654, 0, 0, 0],
        1e-4 * np.ones((6, 2)),
        1e-4 * np.eye(6, 2),
    )
    small.write()
    _, alone = draw(small, "path").axes
    path = 1e6 * (small.numbers("trajectory.csv", "x", "y", "z") - [0, 0, -0.654])
    found = [np.column_stack(line.get_data_3d()) for line in alone.get_lines()]
    assert any(np.allclose(line[:-1], path) for line in found if len(line) == len(path) + 1)
    assert alone.get_xlabel() == "$x$ (µm)"
    assert np.diff(alone.get_xlim())[0] < 2000
    assert "Displacement from home" in [text.get_text() for text in alone.figure.texts]


def home_joints(record):
    robot = record.configuration.robot
    return robot.struts_at(robot.home).joints


def test_home_joints_are_where_the_inverse_kinematics_says(run):
    record = DesignResult.read(run.folder)
    lengths = np.linalg.norm(home_joints(record) - record.robot.description.base_joints, axis=1)
    np.testing.assert_allclose(lengths, record.robot.inverse_kinematics(record.robot.home))


def test_robot_is_drawn_at_home(run):
    record = DesignResult.read(run.folder)
    robot = draw(run, "path").axes[0]
    found = [np.column_stack(line.get_data_3d()) for line in robot.get_lines()]
    base, joints = record.robot.description.base_joints, home_joints(record)
    for j in range(6):
        strut = 1e3 * np.stack([base[j], joints[j]])
        assert any(line.shape == (2, 3) and np.allclose(line, strut) for line in found)
    assert texts(robot) == [str(j) for j in STRUTS]


def test_eigenvalues(run):
    first, second = draw(run, "eigenvalues").axes
    table = run.numbers("tables/eigenvalues.csv", "index", "eigenvalue", "eigenvalue_nominal")
    for axes, column in ((first, 1), (second, 2)):
        assert axes.get_yscale() == "log"
        (line,) = axes.get_lines()
        np.testing.assert_array_equal(line.get_xdata(), table[:, 0])
        np.testing.assert_array_equal(line.get_ydata(), table[:, column])
    assert texts(first) == ["condition number 750"]


def test_eigenvalues_that_are_not_positive(run):
    path = run.folder / "tables/eigenvalues.csv"
    head, *rows = path.read_text().splitlines()
    values = [-1e-17, 0.0, *np.linspace(0.5, 2, len(rows) - 2).tolist()]
    changed = [f"{k},{value},1" for k, value in enumerate(values, start=1)]
    path.write_text("\n".join([head, *changed]))
    axes, _ = draw(run, "eigenvalues").axes
    positive, lost = axes.get_lines()
    np.testing.assert_array_equal(positive.get_ydata(), values[2:])
    np.testing.assert_array_equal(lost.get_xdata(), [1, 2])
    assert texts(axes) == ["2 not positive: singular to working precision"]


def test_precision(run):
    (axes,) = draw(run, "precision").axes
    percent = run.numbers(
        "tables/parameters.csv", "rel_std_percent_per_period", "rel_std_percent_experiment"
    )
    assert axes.get_yscale() == "log"
    for bars, expected in zip(axes.containers, percent.T, strict=True):
        tops = [bar.get_y() + bar.get_height() for bar in bars]
        np.testing.assert_allclose(tops, expected, rtol=1e-9)
    ticks = [label.get_text() for label in axes.get_xticklabels()]
    assert ticks[:2] == ["$p_{1}$", "$p_{2}$"]
    assert ticks[10] == r"$r_{\alpha}$"
    assert [list(line.get_ydata()) for line in axes.get_lines()] == [[50, 50]]
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend[1] == "experiment (10 periods, 2\u202f000 samples)"


@pytest.mark.parametrize(
    ("systematic", "prior", "named", "absent"),
    [
        ({}, None, [], ["tolerances", "prior"]),
        ({"p1": 1.0}, None, ["tolerances"], ["prior"]),
        ({}, "identified-robot.yaml", ["prior"], ["tolerances"]),
        ({"p1": 1.0}, "identified-robot.yaml", ["tolerances", "prior"], []),
    ],
)
def test_the_caption_of_precision_is_that_of_the_design(original, systematic, prior, named, absent):
    record = original.record()
    result = replace(
        record,
        predicted_std=replace(record.predicted_std, systematic=systematic),
        configuration=record.configuration.with_section("design", prior=prior),
    )
    caption = Drawing(precision_figure, result).caption
    assert "The experiment determines best" in caption
    assert all(word in caption for word in named)
    assert not any(word in caption for word in absent)


def test_precision_without_a_nominal_value(run):
    path = run.folder / "tables/parameters.csv"
    lines = path.read_text().splitlines()
    lines[1] = "p1,1,0.0,0.1,0.01,,,,,"
    path.write_text("\n".join(lines))
    (axes,) = draw(run, "precision").axes
    assert [len(bars) for bars in axes.containers] == [23, 23]
    assert "nominal value 0" in texts(axes)


def test_convergence(run):
    objective, violation = draw(run, "convergence").axes
    table = run.numbers("tables/convergence.csv", "start", "iteration", "objective", "violation")
    lines = [line for line in objective.get_lines() if len(line.get_xdata()) > 2]
    widths = [line.get_linewidth() for line in lines]
    assert np.argmax(widths) == 1  # the best start
    assert len({line.get_color() for line in lines}) == 3
    for start in range(3):
        rows = table[table[:, 0] == start]
        np.testing.assert_array_equal(lines[start].get_xdata(), rows[:, 1])
        np.testing.assert_array_equal(lines[start].get_ydata(), rows[:, 2])
        np.testing.assert_array_equal(
            violation.get_lines()[start].get_ydata(), np.maximum(rows[:, 3], FLOOR)
        )
    assert objective.get_ylabel() == "log det F (SI units)"
    legend = [text.get_text() for text in objective.figure.legends[0].get_texts()]
    assert legend == ["the best", "1 other start", "1 hop", "written design, not smoothed: 97.25"]
    assert texts(objective) == [PHASE_TITLES["blunt"], PHASE_TITLES["sharp"]]


def test_a_start_that_left_the_limits_does_not_set_the_scale(run):
    path = run.folder / "tables/convergence.csv"
    head, *rows = path.read_text().splitlines()
    place = head.split(",").index("objective")
    cells = rows[-1].split(",")
    cells[place] = "500.0"
    path.write_text("\n".join([head, *rows[:-1], ",".join(cells), ""]))
    objective, _ = draw(run, "convergence").axes
    low, high = objective.get_ylim()
    assert low < 97.25 < high < 200


def test_convergence_of_another_criterion_begins_where_its_numbers_do(run):
    """The blunt stage maximises log det F: its numbers are on no common axis with the rest."""
    design = json.loads((run.folder / "design.json").read_text())
    (run.folder / "design.json").write_text(json.dumps(design | {"criterion": "a"}))
    path = run.folder / "tables/convergence.csv"
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(row for row in rows if "blunt" not in row)]))
    objective, violation = draw(run, "convergence").axes
    first = min(line.get_xdata()[0] for line in violation.get_lines())
    assert first == 10
    assert 9 < violation.get_xlim()[0] < 10
    assert "log det F" in violation.get_xlabel()
    assert objective.get_ylabel() == "trace of F⁻¹ (SI units)"


@pytest.mark.parametrize(
    ("status", "says"), [("interrupted", "interrupted"), ("limits broken", "breaks a limit")]
)
def test_figures_of_a_design_without_a_good_end_say_so(run, monkeypatch, status, says):
    design = json.loads((run.folder / "design.json").read_text())
    (run.folder / "design.json").write_text(json.dumps(design | {"status": status}))
    drawn = []

    def fill(figure, record):
        excitation_figure.fill(figure, record)
        drawn.append(figure)

    monkeypatch.setattr(
        "results.views.design.DESIGN_FIGURES", (replace(excitation_figure, fill=fill),)
    )
    design_figures(DesignResult.read(run.folder), run.folder)
    assert says in drawn[0].get_supxlabel()
    with house_style():
        drawn[0].canvas.draw()
    assert np.all(np.asarray(drawn[0].canvas.buffer_rgba())[-1] == 255)


def test_convergence_without_iterations(run):
    header = "start,kind,stage,iteration,objective,violation\n"
    (run.folder / "tables/convergence.csv").write_text(header)
    objective, _ = draw(run, "convergence").axes
    assert texts(objective) == ["no iterations were recorded"]


def test_limits_used(run):
    (axes,) = draw(run, "limits_used").axes
    titles = [label.get_text() for label in axes.get_yticklabels()]
    assert titles == [
        "Actuator force",
        "Clearance between struts",
        "TCP position",
        "Tilt of the platform",
    ]
    widths = {
        round(bar.get_y() + bar.get_height() / 2): bar.get_width()
        for bars in axes.containers
        for bar in bars
    }
    expected = [100, 75, 100 * (1 - 2 * 0.046 / 0.3), 100 * 0.2 / np.deg2rad(20)]
    np.testing.assert_allclose([widths[k] for k in range(4)], expected)
    assert "−230 (−230 N)" in texts(axes)
    assert "strut 3, at 0.50 s" in texts(axes)
    assert "11.46 (20°)" in texts(axes)


def test_a_value_below_its_bound_does_not_read_as_the_bound(run):
    path = run.folder / "tables/limits.csv"
    rows = path.read_text().splitlines()
    first = f"tilt,tilt,,rad,{np.deg2rad(19.9991)},{np.deg2rad(20)},-0.000045,0.25,".split(",")
    rows[2] = ",".join([*first, *rows[2].split(",")[len(first) :]])
    path.write_text("\n".join(rows))
    (axes,) = draw(run, "limits_used").axes
    assert "19.999 (20°)" in texts(axes)


@pytest.mark.parametrize(
    ("key", "value", "bound", "violation", "share"),
    [
        ("strut_speed", 2.0, 2.0, 0.0, 1.0),
        ("strut_speed", 0.0, 2.0, -0.5, 0.0),
        ("tilt", 0.1, 0.2, -0.5, 0.5),
        ("strut_clearance", 0.03, 0.015, -1.0, 0.5),
        ("strut_clearance", 0.010, 0.015, 1 / 3, 1.5),
        ("strut_clearance", -0.1, 0.0, 0.1, 1.1),
        ("a limit of a later version", 1.5, 1.0, 0.5, 1.5),
    ],
)
def test_share_of_a_limit(key, value, bound, violation, share):
    check = LimitCheck(key, "", "", "1", value, bound, violation, 0.0, "")
    assert check.used == pytest.approx(share)
