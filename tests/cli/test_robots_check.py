"""`expdesign robots` and `expdesign check`, and how bad input ends."""

import json
import os
import subprocess
import sys

import pytest
import typer

from expdesign.cli.app import run
from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files
from expdesign.stages.stage import StageFailed

ROBOT = resolved_yaml(load_run("palida")).split("robot:\n")[1].split("\ntrajectory")[0]


@pytest.fixture
def run_file(tmp_path):
    """Write a run file whose robot, PaLiDA, stands in it."""

    def write(text="", robot=ROBOT):
        path = tmp_path / "run.yaml"
        path.write_text(f"name: test\nrobot:\n{robot}\n{text}\n", encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(
    ("motion", "key"),
    [
        ({"motion": "circle", "speed": 1e-12, "periods": 100}, "validate[1].periods"),
        ({"motion": "circle", "periods": 100_000}, "validate[1].periods"),
        ({"motion": "line", "poses": [[0] * 6] * 2}, "validate[1]"),
    ],
)
def test_a_motion_that_cannot_be_validated_on(motion, key, tmp_path, expdesign):
    (tmp_path / "run.yaml").write_text(
        json.dumps({"name": "lab", "robot": "palida", "validate": [motion]})
    )
    status, _, error = expdesign("check", tmp_path / "run.yaml")
    assert status == 2
    assert key in error


def test_robots_lists_geometry_limits_and_source(expdesign, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    status, out, err = expdesign("robots")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [line for line in lines if line and not line.startswith(" ")] == list(robot_files())
    assert max(len(line) for line in lines) <= 100
    assert len(lines) < 80
    together = " ".join(out.split())
    for text in ("struts at home 0.6762 m", "strut speed ±2 m/s", "Sourced"):
        assert text in together


@pytest.mark.parametrize("width", ["20", "80", "400"])
def test_robots_at_any_width(expdesign, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", width)
    assert expdesign("robots")[0] == 0


def test_robots_as_json(expdesign):
    status, out, err = expdesign("robots", "--json")
    assert (status, err) == (0, "")
    robots = {robot["name"]: robot for robot in json.loads(out)}
    assert robots["palida"]["limits"]["tilt"]["lower"] == [None]
    assert robots["palida"]["limits"]["strut_speed"]["upper"] == [2.0] * 6
    assert robots["palida"]["at_home"]["jacobian_condition"] == pytest.approx(2.401, abs=1e-3)
    joints = load_robot_description("linuxcnc").base_joints.tolist()
    assert robots["linuxcnc"]["base_joints"] == joints


def test_check_prints_the_resolved_configuration(expdesign):
    status, out, err = expdesign("check", "palida")
    assert status == 0
    assert out == resolved_yaml(load_run("palida"))
    assert "warning: physically inconsistent parameters: p2" in err


def test_check_lists_struts_that_share_a_joint(expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("name: a\nrobot: linuxcnc\n", encoding="utf-8")
    status, out, err = expdesign("check", path)
    assert status == 0
    for pair in ("1 and 6", "2 and 3", "4 and 5"):
        assert f"struts {pair} share a joint" in err
    status, out, err = expdesign("check", "--json", path)
    assert (status, err) == (0, "")
    data = json.loads(out)
    assert data["shared_joints"] == [[1, 6], [2, 3], [4, 5]]
    assert data["stages"] == []
    assert data["configuration"]["design"]["parameters"] == "all"
    assert load_run(data["configuration"]).run.name == "a"


def test_check_tells_what_is_limited_by_default(expdesign, run_file):
    def told(robot):
        path = run_file(robot=robot)
        notes = [x for x in expdesign("check", path)[2].splitlines() if x.startswith("note:")]
        listed = json.loads(expdesign("check", "--json", path)[1])["limits_by_default"]
        return [text for text in notes if "default" in text], listed

    (note,), (text,) = told(ROBOT.replace("rotation: none", "rotation: {psi: [-1, 1]}"))
    assert note.endswith(text)
    for name in ("phi, theta", "30 deg", "rotation: none"):
        assert name in text
    assert told(ROBOT) == ([], [])


def test_check_tells_which_limit_holds_the_attitude(expdesign, run_file):
    path = run_file()
    assert "limits.attitude" in expdesign("check", path)[2]
    told = json.loads(expdesign("check", "--json", path)[1])
    (text,) = told["limits_held_by_others"]
    assert "limits.tilt" in text
    lifted = ROBOT.replace("tilt: 0.3490658503988659", "strut_clearance: 0.001")
    path = run_file(robot=lifted.replace("strut_clearance: 0.015", ""))
    told = json.loads(expdesign("check", "--json", path)[1])
    assert told["limits_held_by_others"] == []
    (text,) = told["limits_by_default"]
    assert "limits.attitude" in text
    assert not any("attitude" in one for one in told["limits_not_set"])


def test_check_tells_the_reserve(expdesign, run_file):
    path = run_file("limits: {reserve: {tilt: 4 %}}")
    (note,) = [line for line in expdesign("check", path)[2].splitlines() if "reserve" in line]
    assert note.startswith("note:")
    assert "4 % of tilt" in note
    told = json.loads(expdesign("check", "--json", path)[1])["reserve"]
    assert {key: share for key, share in told.items() if share} == {"tilt": 0.04}


def test_what_check_prints_can_be_checked(expdesign, tmp_path):
    _, out, _ = expdesign("check", "palida-quick")
    path = tmp_path / "resolved.yaml"
    path.write_text(out, encoding="utf-8")
    assert expdesign("check", path)[:2] == (0, out)


def test_check_says_what_run_would_do(expdesign, tmp_path):
    path = tmp_path / "run.yaml"

    def check(text):
        path.write_text(f"name: a\nrobot: palida\n{text}", encoding="utf-8")
        return expdesign("check", path)

    _, out, err = check("")
    assert "note: expdesign run does: design (the file names no stage)" in err
    assert "# data:" in out
    assert "periods and sampling of the experiment" in out
    _, out, err = check("design: {}\nexperiment: {}\nmontecarlo: {}\ndata: {delimiter: ';'}\n")
    assert "note: expdesign run does: design, experiment, montecarlo\n" in err
    assert "\ndata:" in out
    assert "periods and sampling of the experiment" not in out
    _, _, err = check("montecarlo: {}\n")
    assert "warning: expdesign run refuses this file" in err


def test_a_wrong_bound_is_answered_in_the_units_of_the_user(expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text(
        "name: a\nrobot: palida\nlimits: {strut_length: [330, 880], jacobian_condition: 2, "
        "alpha: [5 deg, 35 deg]}\n",
        encoding="utf-8",
    )
    status, _, err = expdesign("check", path)
    assert status == 2
    assert err.count("error: ") == 3  # one for each limit, not one for each strut
    assert "strut length of all struts is 0.676162 m" in err
    assert "did you mean '[330 mm, 880 mm]'?" in err
    assert "allowed: 330 m to 880 m" in err
    assert "allowed: at most 2\n" in err
    assert "allowed: 5 deg to 35 deg" in err


def test_a_bound_of_the_size_of_what_it_bounds_is_no_slip_of_the_unit(expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    limits = "{strut_clearance: 200 mm, strut_length: [800 mm, 900 mm]}"
    path.write_text(f"name: a\nrobot: palida\nlimits: {limits}\n", encoding="utf-8")
    status, _, err = expdesign("check", path)
    assert status == 2
    assert err.count("error: ") == 2
    assert "did you mean" not in err


def test_what_is_allowed_for_several_is_said_once(expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    names = ", ".join(f"q{number}" for number in range(13))
    path.write_text(f"name: a\nrobot: palida\ndesign: {{parameters: [{names}]}}\n", "utf-8")
    status, _, err = expdesign("check", path)
    assert status == 2
    assert err.count("error: ") == 13
    assert err.count("r_alpha") == 1


# --- bad input ----------------------------------------------------------------------------------

BAD_RUNS = {
    "negative harmonics": ("trajectory: {harmonics: -1}", "trajectory.harmonics: -1 is out of"),
    "zero harmonics": ("trajectory: {harmonics: 0}", "trajectory.harmonics: 0 is out of range"),
    "min > max": ("limits: {strut_length: [0.9, 0.4]}", "min 0.9 is not below max 0.4"),
    "wrong unit": ("limits: {strut_length: [5 kg, 9 kg]}", "'5 kg' is a mass, not a length"),
    "nan": ("limits: {tilt: .nan}", "nan is not a finite number"),
    "infinite": ("limits: {tilt: .inf}", "inf is not a finite number"),
    "covariance": (
        "noise: {force_covariance: [" + ", ".join(["[1, 1, 1, 1, 1, 1]"] * 6) + "]}",
        "not positive definite",
    ),
    "duplicate key": ("design: {seed: 1, seed: 2}", "the key occurs twice"),
    "tag": ("data: !!python/object/apply:os.system [true]", "tag !!python/object/apply:os.system"),
    "unknown key": ("desing: {}", "unknown key 'desing'"),
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_bad_input_is_one_clear_message(expdesign, run_file, case):
    text, says = BAD_RUNS[case]
    path = run_file(text)
    status, out, err = expdesign("check", path)
    assert (status, out) == (2, "")
    assert err.count("error: ") == 1
    assert err.startswith(f"error: {path}:")
    assert says in err
    assert "Traceback" not in err
    status, out, err = expdesign("check", path, "--json")
    assert (status, err) == (2, "")
    data = json.loads(out)
    assert data["status"] == 2
    (problem,) = data["problems"]
    assert problem["file"] == str(path)
    assert problem["line"] > 50
    assert says.split(": ", 1)[-1] in problem["message"]


BAD_ROBOTS = {
    "five joints": (
        ROBOT.replace("    - [0.4456206309337067, -0.06262789543202944, 0.0]\n", ""),
        "robot.base_joints: there are 5 joints where 6 are needed",
    ),
    "home breaks a limit": (
        ROBOT.replace("home: [0.0, 0.0, -0.654", "home: [0.0, 0.0, -0.9"),
        "the home pose breaks this limit",
    ),
    "singular": (
        ROBOT.replace("home: [0.0, 0.0, -0.654", "home: [0.0, 0.0, -0.104"),
        "robot.home: the robot is singular at home",
    ),
    "angles singular at home": (
        ROBOT.replace("home: [0.0, 0.0, -0.654, 0.0, 0.0", "home: [0.0, 0.0, -0.654, 0.0, 90 deg"),
        "robot.home: the angles of the pose are singular at home",
    ),
}


@pytest.mark.parametrize("case", BAD_ROBOTS)
def test_bad_robots(expdesign, run_file, case):
    robot, says = BAD_ROBOTS[case]
    status, out, err = expdesign("check", run_file(robot=robot))
    assert (status, out) == (2, "")
    assert says in err
    assert err.count("error: ") == 1


def test_home_outside_a_limit_of_the_run(expdesign, run_file):
    status, out, err = expdesign("check", run_file("limits: {position: {z: [-0.6, -0.5]}}"))
    assert (status, out) == (2, "")
    assert "limits.position" in err
    assert "-0.654" in err


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"\x7fELF\0\0", "the file is binary"),
        (b"\x80abc", "byte 0x80 is not UTF-8"),
        (b"a: [1", "not valid YAML"),
    ],
)
def test_bad_files(expdesign, tmp_path, content, says):
    path = tmp_path / "run.yaml"
    path.write_bytes(content)
    status, out, err = expdesign("check", path)
    assert (status, out) == (2, "")
    assert says in err
    assert err.count("error: ") == 1


def test_missing_file_and_folder(expdesign, tmp_path):
    assert expdesign("check", tmp_path / "missing.yaml")[0] == 2
    status, _, err = expdesign("check", tmp_path)
    assert status == 2
    assert "this is a folder" in err


def test_messages_help(expdesign, run_file):
    _, _, err = expdesign("check", run_file("design: {criterium: d, start: periodical}"))
    assert "did you mean 'criterion'?" in err
    assert "did you mean 'periodic'?" in err
    assert "allowed: periodic | rest" in err
    _, _, err = expdesign("check", "palidda")
    assert "did you mean 'palida'?" in err


def test_markup_and_escapes_in_a_file_stay_text(expdesign, run_file):
    _, _, err = expdesign("check", run_file('design: {"[red]x": 1, "\\e[31m": 2}'))
    assert "[red]x" in err
    assert "\x1b" not in err


def test_files_are_named_as_the_user_would(expdesign, run_file, monkeypatch, tmp_path):
    run_file("design: {seed: -1}")
    monkeypatch.chdir(tmp_path)
    _, _, err = expdesign("check", "run.yaml")
    assert err.startswith("error: run.yaml:")


# --- usage --------------------------------------------------------------------------------------


@pytest.mark.parametrize("arguments", [["--help"], ["check", "--help"], ["robots", "-h"]])
def test_help(expdesign, arguments):
    status, out, err = expdesign(*arguments)
    assert (status, err) == (0, "")
    assert "Usage" in out


def test_version(expdesign):
    status, out, _ = expdesign("--version")
    assert status == 0
    assert out.strip()


@pytest.mark.parametrize("arguments", [["chek"], ["check"], ["check", "a", "b"], ["robots", "--x"]])
def test_wrong_usage(expdesign, arguments):
    status, out, err = expdesign(*arguments)
    assert (status, out) == (2, "")
    assert "Error" in err
    status, out, err = expdesign(*arguments, "--json")
    assert (status, err) == (2, "")
    assert json.loads(out)["problems"][0]["message"]


# --- other ends ---------------------------------------------------------------------------------


def _app_that(error):
    other = typer.Typer()

    @other.command()
    def fail(as_json: bool = typer.Option(False, "--json")) -> None:
        raise error

    return other


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (StageFailed("tilt is exceeded", {"limit": "tilt"}), 1, "failed: tilt is exceeded"),
        (PermissionError(13, "Permission denied", "/out"), 1, "/out: Permission denied"),
        (typer.Exit(1), 1, ""),
        (typer.Exit(0), 0, ""),
        (KeyboardInterrupt(), 1, ""),
    ],
)
def test_how_commands_end(capsys, error, status, says):
    assert run(_app_that(error), []) == status
    assert says in capsys.readouterr().err
    assert run(_app_that(error), ["--json"]) == status
    out = capsys.readouterr().out
    if isinstance(error, StageFailed):
        assert json.loads(out) == {"status": 1, "message": "tilt is exceeded", "limit": "tilt"}


def test_a_bug_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run(_app_that(ZeroDivisionError()), [])


def test_the_console_script(tmp_path):
    code = "from expdesign.cli import main; main()"

    def command(*arguments):
        return subprocess.run(
            [sys.executable, "-W", "error", "-c", code, *arguments],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONIOENCODING": "ascii"},
        )

    good = command("check", "palida")
    assert good.returncode == 0, good.stderr
    bad = command("check", str(tmp_path))
    assert bad.returncode == 2
    assert "Traceback" not in bad.stderr


def test_help_loads_no_numerics():
    code = (
        "import sys, expdesign.cli.app\n"
        "print([name for name in ('casadi', 'numpy', 'pydantic') if name in sys.modules])"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert loaded.stdout == "[]\n"


@pytest.mark.parametrize("given", ["rubin", robot_files()["rubin"]])
def test_a_robot_in_place_of_a_run_is_told_so(given, expdesign):
    status, _, error = expdesign("check", given)
    assert status == 2
    assert error.count("error:") == 1
    assert "robot: rubin" in error


def test_a_help_shows_the_default_folder(expdesign):
    for command in ("check", "design", "estimate"):
        assert "runs/NAME" in expdesign(command, "--help")[1]


def test_check_tells_rounding_from_a_contradiction(expdesign, run_file):
    told = {}
    for p2 in ("0.944", "0.947"):
        assert "p2: 0.947" in ROBOT
        path = run_file(robot=ROBOT.replace("p2: 0.947", f"p2: {p2}"))
        told[p2] = expdesign("check", path)[2]
        within = json.loads(expdesign("check", "--json", path)[1])["within_rounding"]
        assert bool(within) == (p2 == "0.944")
        assert within in told[p2]
    assert "note: the parameters are physically consistent within" in told["0.944"]
    assert "physically inconsistent" not in told["0.944"]
    assert "physically inconsistent" in told["0.947"]


@pytest.mark.parametrize(
    "arguments", [["run", "wrong.yaml"], ["estimate", "right.yaml", "--data", "wrong.yaml"]]
)
def test_bad_input_is_refused_before_the_modules_of_the_computation_are_loaded(tmp_path, arguments):
    run = "name: n\nrobot: palida\n"
    (tmp_path / "right.yaml").write_text(run)
    (tmp_path / "wrong.yaml").write_text(f"{run}trajectory: {{harmonic: 5}}\n")
    code = (
        "import sys; from expdesign.cli.app import app, run; "
        f"print(run(app, {arguments}), sorted(m for m in sys.modules if m in "
        "{'pandas.core', 'numba', 'scipy.optimize', 'expdesign.solver.search', "
        "'estimation.identification.estimate'}))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "2 []", answer.stderr
