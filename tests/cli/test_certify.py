"""`expdesign certify`: what is proved of a run folder and of a table, and its exit status."""

import json
import re
import shutil

import numpy as np
import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.run import robot_yaml
from expdesign.configuration.tolerances import Identification, IdentifiedDeviation
from expdesign.recheck.limit_check import LimitCheck
from expdesign.robot import load_robot, robot_from
from expdesign.runfolder.manifest import Manifest, StageEntry, file_hash
from expdesign.trajectory import FourierTrajectory
from tests.export.motions import spline_motion_of, task

SMALL = 0.3
TABLES = [
    {"format": "xps-pvt", "segment": "10 ms", "tolerance": "50 um"},
    {"format": "linuxcnc-gcode", "servo_period": "1 ms"},
]


def write_folder(folder, size):
    """Write a run folder whose design goes as far as that of the tests of tables, times a size."""
    about = task()
    design = about.motion.trajectory
    mu, nu = size * design.mu, size * design.nu
    trajectory = FourierTrajectory(design.omega, about.robot.home, mu, nu)
    folder.mkdir(exist_ok=True)
    data = {"harmonics": trajectory.harmonics, "omega": trajectory.omega}
    data |= {key: getattr(trajectory, key).tolist() for key in ("lambda0", "mu", "nu")}
    (folder / "design.json").write_text(json.dumps(data), encoding="utf-8")
    run = {
        "name": "test",
        "robot": "palida",
        "experiment": {"periods": 1, "sampling": 500},
        "export": TABLES,
    }
    file = folder / "input.yaml"
    file.write_text(json.dumps(run), encoding="utf-8")
    (folder / "run.yaml").write_text(resolved_yaml(load_run(file)), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def made(made_once):
    """Return a run folder with two tables, whose ways are splines that need no search."""
    from expdesign.cli.app import app, run

    def make(place):
        def ways(configuration, trajectory):
            return spline_motion_of(task().robot, trajectory, configuration.run.experiment.periods)

        folder = write_folder(place / "run", SMALL)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("expdesign.stages.export.executable_motion", ways)
            for one in TABLES:
                assert run(app, ["export", str(folder), "--format", one["format"], "--json"]) == 0

    return made_once("certified-run", make) / "run"


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "run")


def test_a_folder_with_its_ways_and_tables_is_proved(expdesign, made):
    status, answer, messages = expdesign("certify", made, "--json")
    found = json.loads(answer)

    assert status == 0, messages
    assert found["certified"]
    names = ["design", "motion", "xps-pvt.trj", "linuxcnc-gcode.ngc"]
    assert [part["name"] for part in found["parts"]] == names
    for part in found["parts"]:
        assert part["certified"]
        for limit in part["limits"]:
            if limit["key"] not in part["sampled"]:
                assert limit["proved"] <= 1e-6
                assert limit["cells"] > 0
    assert set(found["parts"][-1]["sampled"]) == {"actuator_force", "strut_acceleration"}
    record = json.loads((made / "exports" / "exports.json").read_text())
    for name in names[2:]:
        check = record["files"][name]["read_back"]
        assert check["certified"]
        by_key = {
            limit["key"]: limit
            for limit in next(part for part in found["parts"] if part["name"] == name)["limits"]
        }
        for key, limit in check["limits"].items():
            assert limit["proved"] == by_key[key]["proved"]


def test_what_is_left_of_a_limit_is_the_same_share_as_in_the_design(expdesign, made):
    printed = expdesign("certify", made)[1]
    lines = printed[: printed.index("motion:")].splitlines()
    limits = json.loads(expdesign("certify", made, "--json")[1])["parts"][0]["limits"]
    assert len(limits) > 8
    for limit in limits:
        known = {key: value for key, value in limit.items() if key not in ("kept", "certified")}
        (line,) = (one for one in lines if one.startswith(f"{limit['key']} "))
        share = float(line.split()[-3])
        assert share == pytest.approx(100 * LimitCheck(**known).left, rel=5e-3)


def test_a_table_alone_and_elsewhere(expdesign, made, tmp_path):
    table = made / "exports" / "xps-pvt.trj"
    status, answer, messages = expdesign("certify", table)
    assert status == 0, messages
    assert "strut_speed" in answer

    away = tmp_path / "away"
    away.mkdir()
    for file in (table, made / "exports" / "exports.json"):
        shutil.copy(file, away)
    status, _, messages = expdesign("certify", away / table.name)
    assert (status, "--design" in messages) == (2, True)
    status, answer, _ = expdesign("certify", away / table.name, "--design", made, "--json")
    assert (status, len(json.loads(answer)["parts"])) == (0, 1)


def test_a_table_that_was_copied_alone_is_known_by_its_digest(expdesign, made, tmp_path):
    away = tmp_path / "away"
    away.mkdir()
    copied = away / "motion of today.txt"
    shutil.copy(made / "exports" / "xps-pvt.trj", copied)

    status, answer, messages = expdesign("certify", copied, "--design", made)
    assert status == 0, messages
    assert "strut_speed" in answer
    assert "xps-pvt.trj" in messages, "it says what the file is taken for"
    assert "exports.json" in messages

    copied.write_text(copied.read_text() + "\n")
    status, answer, messages = expdesign("certify", copied, "--design", made)
    assert (status, answer) == (2, "")
    assert "exports.json" in messages


def write_robot(path, folder, **changes):
    """Write the robot of a run folder with changes, and return the path."""
    description = load_run(folder / "run.yaml").robot.description
    path.write_text(robot_yaml(description.model_copy(update=changes)), encoding="utf-8")
    return path


def heavier(folder, factor):
    """Return the keys of a robot whose platform has other parameters, and an identification."""
    own = load_run(folder / "run.yaml").robot
    values = {name: factor * value for name, value in own.parameters.items()}
    spread = np.diag([(0.01 * value) ** 2 for value in values.values()]).tolist()
    known = Identification(
        run="r",
        estimator="ml",
        verdict="accepted",
        parameters=tuple(values),
        covariance_random=spread,
        covariance_systematic=np.zeros_like(spread).tolist(),
    )
    return {"parameters": values, "bodies": None, "identification": known}


def test_the_motions_of_a_folder_are_judged_for_the_identified_robot(expdesign, made, tmp_path):
    robot = write_robot(tmp_path / "heavier.yaml", made, **heavier(made, 1.05))
    status, answer, messages = expdesign("certify", made, "--robot", robot, "--json")
    parts = json.loads(answer)["parts"]
    assert status == 0, messages
    assert [part["name"] for part in parts][:3] == ["design", "motion", "xps-pvt.trj"]
    own = json.loads(expdesign("certify", made, "--json")[1])["parts"]
    for found, before in zip(parts[:3], own[:3], strict=True):
        force, expected = (
            next(one for one in part["limits"] if one["key"] == "actuator_force")["value"]
            for part in (found, before)
        )
        assert force == pytest.approx(1.05 * expected, rel=1e-5), "forces are linear in all of them"
    for part, instants in zip(parts[:2], (400, 401), strict=True):
        (remark,) = part["remarks"]
        assert "limit -230 N, kept, also with 2 σ" in remark
        assert int(remark.split(" at ")[1].split()[0]) >= instants


def test_an_identified_robot_that_breaks_a_limit_exits_with_1(expdesign, made, tmp_path):
    robot = write_robot(tmp_path / "heavier.yaml", made, **heavier(made, 5.0))
    status, answer, _ = expdesign("certify", made, "--robot", robot, "--json")
    found = json.loads(answer)
    assert (status, found["verdict"]) == (1, "broken")
    assert "design: breaks actuator_force" in found["message"]
    assert "exceeded by" in found["parts"][0]["remarks"][0]


def test_a_reserve_is_kept_free_for_other_machines(expdesign, made, tmp_path):
    own = load_run(made / "run.yaml").robot.description
    limits = {**own.limits, "reserve": 0.2}
    robot = write_robot(tmp_path / "reserved.yaml", made, limits=limits)
    answers = [
        json.loads(expdesign("certify", made, *options, "--json")[1])
        for options in ((), ("--robot", robot))
    ]
    first, second = (one["parts"][0]["limits"] for one in answers)
    assert [one["bound"] for one in first] == [one["bound"] for one in second]


def test_tables_are_not_examined_for_other_joints(expdesign, made, tmp_path):
    own = load_run(made / "run.yaml").robot
    joints = tuple(map(tuple, np.add(own.base_joints, [0, 0, 1e-4]).tolist()))
    robot = write_robot(tmp_path / "moved.yaml", made, base_joints=joints)
    status, answer, messages = expdesign("certify", made, "--robot", robot, "--json")
    assert status == 0, messages
    assert [part["name"] for part in json.loads(answer)["parts"]] == ["design", "motion"]
    status, _, messages = expdesign("certify", made, "--robot", robot)
    assert "not examined: xps-pvt.trj, linuxcnc-gcode.ngc" in messages
    assert "`expdesign certify DIR` examines" in messages


@pytest.mark.parametrize("part", ["exports", "design.json", "run.yaml"])
def test_parts_of_a_run_folder_are_told_the_folder(expdesign, folder, part):
    status, answer, messages = expdesign("certify", folder / part, "--json")
    (problem,) = json.loads(answer)["problems"]
    assert (status, messages) == (2, "")
    assert problem["file"] == str(folder / part)
    assert problem["allowed"].startswith(str(folder))


def test_a_run_file_is_told_its_folder(expdesign, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    away = tmp_path / "q.yaml"
    shutil.copy(folder / "input.yaml", away)
    status, answer, _ = expdesign("certify", away, "--json")
    (problem,) = json.loads(answer)["problems"]
    assert status == 2
    assert "runs/test" in problem["allowed"]

    status, answer, _ = expdesign("certify", "palida", "--json")
    (problem,) = json.loads(answer)["problems"]
    assert status == 2
    assert "runs/palida" in problem["allowed"]

    away.write_text("something: else\n", encoding="utf-8")
    status, answer, _ = expdesign("certify", away, "--json")
    (problem,) = json.loads(answer)["problems"]
    assert (status, problem["key"]) == (2, "--design")


def _with_row(path, change):
    """Change one displacement and velocity of an XPS table in its middle; the row after undoes
    the displacement."""
    lines = path.read_text().splitlines()
    k = len(lines) // 2
    rows = [np.array([float(cell) for cell in line.split(",")]) for line in lines[k : k + 2]]
    change(*rows)
    lines[k : k + 2] = [", ".join(f"{cell:.8f}" for cell in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def test_what_a_table_does_between_its_rows_alone_is_found(expdesign, folder):
    table = folder / "exports" / "xps-pvt.trj"

    def velocity(row, _after):
        row[2] += 400.0  # mm/s, at one row: the speed stays below its limit there and around it

    _with_row(table, velocity)
    status, answer, _ = expdesign("certify", table, "--json")
    found = json.loads(answer)

    assert status == 1
    assert not found["certified"]
    (part,) = found["parts"]
    limits = {limit["key"]: limit for limit in part["limits"]}
    assert limits["strut_acceleration"]["proved"] > 1e-6
    assert not limits["strut_acceleration"]["certified"]


def test_a_force_that_straight_lines_exceed_at_a_row_is_a_failure(expdesign, folder):
    table = folder / "exports" / "linuxcnc-gcode.ngc"
    status, answer, _ = expdesign("certify", table)
    assert status == 0
    assert "strut_acceleration" in answer.splitlines()[-1], "where it holds at the rows alone"

    lines = table.read_text(encoding="utf-8").splitlines()
    k = len(lines) // 2
    before = re.search(r"Z(-?[\d.]+)", lines[k])
    after = f"Z{float(before.group(1)) + 5.0:.6f}"  # mm: 0.5 m/s for 10 ms, and 100 m/s^2
    lines[k] = lines[k].replace(before.group(0), after)
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    status, _, messages = expdesign("certify", table)
    assert status == 1
    assert "strut_acceleration" in messages
    status, answer, _ = expdesign("certify", table, "--json")
    found = json.loads(answer)
    assert (status, found["certified"]) == (1, False)
    (part,) = found["parts"]
    assert not part["certified"]
    kept = {limit["key"]: limit["certified"] for limit in part["limits"]}
    assert kept["strut_speed"], "of the path itself nothing is broken"


def verdict_of(expdesign, *arguments):
    """Return exit status, verdict, and the parts that are not proved by their names."""
    status, answer, _ = expdesign("certify", *arguments, "--json")
    found = json.loads(answer)
    left = {part["name"]: part for part in found["parts"] if not part["certified"]}
    assert found["certified"] == (status == 0) == (found["verdict"] == "proved")
    return status, found["verdict"], left


def test_a_table_that_ends_on_its_way_is_broken(expdesign, folder):
    table = folder / "exports" / "linuxcnc-gcode.ngc"
    lines = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join([*lines[:-100], "M2"]) + "\n", encoding="utf-8")

    status, verdict, left = verdict_of(expdesign, folder)
    assert (status, verdict, list(left)) == (1, "broken", [table.name])
    faults = " ".join(left[table.name]["faults"])
    assert "the table lasts" in faults
    assert "the table ends at" in faults
    assert expdesign("certify", table)[2].strip().splitlines()[-1].startswith("failed: broken")

    status, answer, messages = expdesign("certify", table, "--part")
    assert "a piece of a motion, which begins 0 mm from home" in answer
    # The planner stops at the end of the piece, faster than the struts may.
    assert status == 1
    assert "broken" in messages
    assert "in single servo cycles strut acceleration of strut" in messages
    assert expdesign("certify", folder, "--part")[0] == 2


def test_further_columns_of_a_piece_are_not_called_proved(expdesign, folder):
    assert expdesign("export", folder, "--format", "csv")[0] == 0
    table = folder / "exports" / "csv.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join(lines[:300]) + "\n", encoding="utf-8")
    status, _, messages = expdesign("certify", table, "--part")
    assert (status, "its further columns" in messages) == (1, True)


def test_what_is_left_out_is_not_called_proved(expdesign, folder):
    exports = folder / "exports"
    (exports / "linuxcnc-gcode.genhexkins.hal").unlink()
    (exports / "xps-pvt.trj").unlink()
    status, verdict, left = verdict_of(expdesign, folder)
    assert (status, verdict) == (1, "proved in part")
    assert "there is no such table" in left["xps-pvt.trj"]["unchecked"][0]
    assert "hal is missing" in left["linuxcnc-gcode.ngc"]["unchecked"][0]


def test_a_damaged_description_is_not_a_missing_one(expdesign, folder):
    (folder / "exports" / "exports.json").write_text("{", encoding="utf-8")
    status, answer, messages = expdesign("certify", folder, "--json")
    assert (status, "no table was exported" in messages) == (1, False)
    assert "exports.json is damaged" in answer + messages


def test_files_without_a_description_are_not_called_proved(expdesign, folder):
    exports = folder / "exports"
    (exports / "photo.jpg").write_bytes(b"")
    status, _, messages = expdesign("certify", folder)
    assert (status, "not examined: photo.jpg" in messages) == (0, True)
    copies = [".hidden.trj", "AGAIN.TRJ", "again.trj", "old/again.trj"]
    for name in copies:
        (exports / name).parent.mkdir(exist_ok=True)
        shutil.copy(exports / "xps-pvt.trj", exports / name)
    status, verdict, left = verdict_of(expdesign, folder)
    assert (status, verdict, list(left)) == (1, "proved in part", copies)


def test_a_changed_program_of_a_table_is_named(expdesign, folder):
    assert expdesign("export", folder, "--format", "ros2")[0] == 0
    table = folder / "exports" / "ros2.yaml"
    program = table.with_name("ros2.publish.py")
    assert verdict_of(expdesign, table)[0] == 0
    program.write_text(program.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    status, verdict, left = verdict_of(expdesign, table)
    assert (status, verdict) == (1, "proved in part")
    assert program.name in left[table.name]["unchecked"][0]
    program.unlink()
    assert verdict_of(expdesign, table)[0] == 0, "a program of the user's own runs the table"


@pytest.mark.parametrize(
    ("ending", "change"),
    [("hal", ("platform.0.x ", "platform.0.x 1")), ("ini", ("MAX_ACCELERATION = ", "\\g<0>1"))],
)
def test_the_settings_of_the_machine_are_those_of_the_export(ending, change, expdesign, folder):
    table = folder / "exports" / "linuxcnc-gcode.ngc"
    (file,) = table.parent.glob(f"{table.stem}.*.{ending}")
    text = file.read_text(encoding="utf-8")
    file.write_text(f"# checked\n{text}", encoding="utf-8")
    assert verdict_of(expdesign, table)[0] == 0
    changed = re.sub(*change, text)
    assert changed != text
    file.write_text(changed, encoding="utf-8")
    status, verdict, left = verdict_of(expdesign, table)
    assert (status, verdict, list(left)) == (1, "proved in part", [table.name])


def test_lead_in_and_tables_of_another_design_are_not_called_proved(expdesign, folder):
    file = folder / "design.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    data["omega"] *= 0.999
    file.write_text(json.dumps(data), encoding="utf-8")
    status, verdict, left = verdict_of(expdesign, folder)
    assert (status, verdict) == (1, "proved in part")
    assert list(left) == ["motion", "xps-pvt.trj", "linuxcnc-gcode.ngc"]


def test_a_design_that_breaks_a_limit_is_not_proved(expdesign, tmp_path):
    folder = write_folder(tmp_path / "far", 2.0)
    status, answer, _ = expdesign("certify", folder, "--json")
    found = json.loads(answer)

    assert status == 1
    assert found["status"] == 1
    assert [part["name"] for part in found["parts"]] == ["design"]
    assert expdesign("certify", folder)[0] == 1


def test_a_design_that_was_changed_by_hand_is_told(expdesign, tmp_path):
    folder = write_folder(tmp_path / "near", SMALL)
    file = folder / "design.json"
    entry = StageEntry("done", "", 1.0, "2026-01-01T00:00:00Z", files={file.name: file_hash(file)})
    Manifest.new({}, "").with_stage("design", entry).write(folder)
    status, _, before = expdesign("certify", folder)
    assert (status, file.name in before) == (0, False)

    data = json.loads(file.read_text(encoding="utf-8"))
    data["omega"] *= 0.999
    file.write_text(json.dumps(data), encoding="utf-8")
    status, _, after = expdesign("certify", folder)
    assert (status, file.name in after) == (0, True), "it is told of, and judged as it is"


@pytest.mark.parametrize("what", ["nothing", "no folder of a run", "a file that is no table"])
def test_bad_input(expdesign, tmp_path, what):
    place = tmp_path / "place"
    if what == "no folder of a run":
        place.mkdir()
    elif what == "a file that is no table":
        place.write_text("1, 2, 3\n", encoding="utf-8")
    status, answer, messages = expdesign("certify", place)
    assert (status, answer) == (2, "")
    assert "Traceback" not in messages


def test_a_folder_and_another_design(expdesign, made):
    assert expdesign("certify", made, "--design", made)[0] == 2


def moved_joints(folder, size):
    """Return joints of a robot that are elsewhere by up to a size, m, in all directions."""
    own, rng = load_run(folder / "run.yaml").robot, np.random.default_rng(4)
    return {
        name: tuple(map(tuple, (getattr(own, name) + rng.uniform(-size, size, (6, 3))).tolist()))
        for name in ("base_joints", "platform_joints")
    }


def zeros_of(folder, zeros):
    """Return the keys of the robot with an identification that has found zeros, m."""
    keys = heavier(folder, 1.0)
    deviations = tuple(
        IdentifiedDeviation(name=f"strut_length_{j}", tolerance=1e-3, value=zero, std=1e-5)
        for j, zero in enumerate(zeros, 1)
    )
    known = keys["identification"]
    response = tuple((0.0,) * 6 for _ in known.parameters)
    changes = {"deviations": deviations, "response": response}
    return keys | {"identification": known.model_copy(update=changes)}


@pytest.mark.parametrize("zeros", [np.zeros(6), 1e-3 * np.array([1, -1, 0, 0.5, 0, -0.5])])
def test_a_machine_with_other_joints_follows_the_commanded_lengths(
    expdesign, made, tmp_path, zeros
):
    changes = moved_joints(made, 1e-3) | (zeros_of(made, zeros.tolist()) if np.any(zeros) else {})
    file = write_robot(tmp_path / "moved.yaml", made, **changes)
    status, answer, messages = expdesign("certify", made, "--robot", file, "--json")
    assert status == 0, messages + json.loads(answer).get("message", "")
    assert "their speeds and accelerations are those commanded" in messages
    before = json.loads(expdesign("certify", made, "--json")[1])["parts"]
    for part, own in zip(json.loads(answer)["parts"], before[:2], strict=True):
        found, planned = ({limit["key"]: limit for limit in one["limits"]} for one in (part, own))
        assert list(found) == list(planned)
        assert all(limit["proved"] <= 1e-6 for limit in found.values())
        for key in {"strut_speed", "strut_acceleration", "strut_jerk"} & set(found):
            assert found[key]["value"] == planned[key]["value"]
    design = json.loads((made / "design.json").read_text())
    trajectory = FourierTrajectory(*(np.array(design[k]) for k in ("omega", "lambda0", "mu", "nu")))
    controller, machine = robot_from(load_run(made / "run.yaml").robot), load_robot(str(file))
    poses = trajectory.sample(np.linspace(0, trajectory.period, 4000)).pose
    lengths = controller.inverse_kinematics(poses) - zeros
    taken = machine.forward_kinematics(lengths, poses)
    limits = {one["key"]: one for one in json.loads(answer)["parts"][0]["limits"]}
    tilt = np.arccos(np.cos(taken[:, 3]) * np.cos(taken[:, 4]))
    assert limits["tilt"]["value"] == pytest.approx(np.max(tilt), rel=1e-5)
    planned_tilt = np.arccos(np.cos(poses[:, 3]) * np.cos(poses[:, 4]))
    assert np.max(tilt) != pytest.approx(np.max(planned_tilt), rel=1e-4)
    worst = limits["strut_length"]
    own = lengths[:, int(worst["row"].split()[1]) - 1]
    assert worst["value"] == pytest.approx(
        min(own, key=lambda q: abs(q - worst["value"])), abs=1e-6
    )
    assert worst["value"] in (
        pytest.approx(own.min(), abs=1e-6),
        pytest.approx(own.max(), abs=1e-6),
    )
    assert limits["actuator_force"]["value"] != before[0]["limits"][0]["value"]


def test_a_broken_limit_of_another_machine_is_told_the_reserve_that_helps(
    expdesign, made, tmp_path
):
    file = write_robot(tmp_path / "moved.yaml", made, **moved_joints(made, 1e-3))
    reached = json.loads(expdesign("certify", made, "--robot", file, "--json")[1])["parts"]
    tilt = max(one["value"] for part in reached for one in part["limits"] if one["key"] == "tilt")
    limits = {**load_run(made / "run.yaml").robot.description.limits, "tilt": tilt / 1.002}
    file = write_robot(tmp_path / "tight.yaml", made, **moved_joints(made, 1e-3), limits=limits)
    status, answer, _ = expdesign("certify", made, "--robot", file, "--json")
    message = json.loads(answer)["message"]
    assert (status, "breaks tilt" in message) == (1, True)
    assert "limits: {reserve: {tilt: 0.3 %}}" in message
    assert f"`robot: {file}`" in message
