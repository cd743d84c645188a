"""The other formats: a Python module, an FMU, an S-function; and what there is without compiler."""

import ctypes
import dataclasses
import importlib.util
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from estimation.controlmodel import formats
from estimation.controlmodel.formats import FLAGS, FORMATS, OUTPUTS
from estimation.controlmodel.model import random_states
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import POSE

HERE = Path(__file__).parent
STATES = ("pose", "rate", "acceleration")
DISCARD = 2
COMPILERS = [pytest.param(name, marks=pytest.mark.system(name)) for name in ("gcc", "clang")]


def _module(folder, model):
    path = folder / f"{model.prefix}.py"
    spec = importlib.util.spec_from_file_location(model.prefix, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_python_module_gives_the_robots_numbers(model, tmp_path):
    made = FORMATS["python"].make(model, tmp_path)
    assert [test.precision for test in made.tests] == ["double"]
    head = (tmp_path / f"{model.prefix}.py").read_text(encoding="utf-8")
    assert "before the filters, low passes and delays of the recorded channels" in head
    module = _module(tmp_path, model)
    robot, states = model.robot, random_states(model.robot, 40, 5)
    pose, rate, acceleration = np.split(states, 3, axis=1)
    motion = robot.strut_motion(pose, rate, acceleration)
    np.testing.assert_allclose(module.lengths(pose), motion.length, atol=1e-13)
    np.testing.assert_allclose(module.rates(pose, rate), motion.length_rate, atol=1e-12)
    found = module.forces(pose, rate, acceleration)
    if model.width == 0:
        expected = robot.actuator_forces(pose, rate, acceleration)
        np.testing.assert_allclose(found, expected, atol=1e-9)
    torque = robot.description.drive.geared.lead / (2 * np.pi)
    assert getattr(module, "TORQUE_PER_FORCE", None) == torque
    one = module.forces(pose[3], rate[3], acceleration[3])
    assert one.shape == (6,)
    np.testing.assert_allclose(one, found[3], atol=1e-10)
    np.testing.assert_allclose(module.pose_rate(pose, motion.length_rate), rate, atol=1e-9)
    reached, status = module.pose(motion.length[3], pose[3] + 0.01)
    assert status == module.OK
    np.testing.assert_allclose(reached, pose[3], atol=1e-10)
    _, status = module.pose(100 * motion.length[3], pose[3])
    assert status != module.OK
    with pytest.raises(ValueError, match="shape"):
        module.lengths(pose[:, :5])
    for value in (np.nan, np.inf):
        _, status = module.pose(np.full(6, value), pose[3])
        assert status == module.NOT_FINITE
        with pytest.raises(ValueError, match="infinite or not a number"):
            module.forces(pose[:2], np.full(6, value), acceleration[:2])
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="infinite or not a number"):
        module.forces(pose[3], np.full(6, 1e200), acceleration[3])


def test_the_python_module_needs_numpy_alone(palida, tmp_path):
    FORMATS["python"].make(palida, tmp_path)
    code = (
        f"import sys; sys.path[:] = [{str(tmp_path)!r}, *sys.path]; import {palida.prefix}; "
        "print(any(name in sys.modules for name in ('casadi', 'scipy', 'expdesign')))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.fixture(scope="module")
def fmu(palida, tmp_path_factory):
    """Its path, and the folder where it is unpacked."""
    folder = tmp_path_factory.mktemp("fmu")
    made = FORMATS["fmu"].make(palida, folder)
    (name,) = made.files
    path = folder / name
    path.write_bytes(made.files[name])
    return path, Path(fmpy.extract(str(path), str(folder / "unpacked")))


def _of_pose(name):
    return [f"{name}.{axis.name}" for axis in POSE]


def _of_actuators(name):
    return [f"{name}[{j}]" for j in range(1, 7)]


@pytest.mark.system("cc")
def test_the_fmu_is_valid_and_gives_the_models_numbers(palida, fmu):
    path, _ = fmu
    assert validate_fmu(str(path)) == []
    vectors = palida.vectors
    named = [name for state in STATES for name in _of_pose(state)]
    named += _of_actuators("measured_lengths") + _of_actuators("measured_rates")
    given = np.zeros(len(vectors.state), dtype=[("time", float), *((n, float) for n in named)])
    given["time"] = np.arange(len(given))
    values = np.hstack([vectors.state, vectors.lengths, vectors.rates])
    for column, each in zip(named, values.T, strict=True):
        given[column] = each
    expected = {tuple(_of_actuators(name)): getattr(vectors, name) for name, *_ in OUTPUTS}
    expected[tuple(_of_actuators("torques"))] = vectors.forces * 0.01 / (2 * np.pi)
    # Each from the pose of the state before.
    expected[tuple(_of_pose("measured_pose"))] = vectors.state[:, :6]
    expected[tuple(_of_pose("measured_rate"))] = vectors.state[:, 6:12]
    steps = {"stop_time": len(given), "step_size": 1, "output_interval": 1}
    outputs = [name for names in expected for name in names]
    result = fmpy.simulate_fmu(str(path), input=given, output=outputs, **steps)
    for names, numbers in expected.items():
        # What was given at the beginning of a step is there at its end.
        found = np.stack([result[name] for name in names], axis=1)[1:]
        np.testing.assert_allclose(found, numbers, atol=1e-8, err_msg=names[0])


class _Unit:
    """An instance of an FMU, and what it has logged."""

    def __init__(self, unpacked):
        described = fmpy.read_model_description(str(unpacked))
        self.references = {one.name: one.valueReference for one in described.modelVariables}
        self.starts = {one.name: one.start for one in described.modelVariables}
        self.logged = []
        self.unit = fmpy.simulation.instantiate_fmu(
            str(unpacked),
            described,
            "CoSimulation",
            logger=lambda *values: self.logged.append(values[-1].decode()),
        )
        self.unit.setupExperiment()
        self.unit.enterInitializationMode()

    def _of(self, names):
        return [self.references[name] for name in names]

    def put(self, names, values):
        self.unit.setReal(self._of(names), list(values))

    def get(self, names):
        return np.array(self.unit.getReal(self._of(names)))

    def step(self):
        self.unit.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e-3)


@pytest.fixture
def unit(fmu):
    made = _Unit(fmu[1])
    yield made
    made.unit.terminate()
    made.unit.freeInstance()


@pytest.mark.system("cc")
def test_the_fmu_finds_no_pose_where_none_was_measured_and_stays_at_home(palida, unit):
    lengths, pose = _of_actuators("measured_lengths"), _of_pose("measured_pose")
    at_home = palida.robot.inverse_kinematics(palida.robot.home)
    np.testing.assert_allclose([float(unit.starts[name]) for name in lengths], at_home)
    unit.put(_of_pose("pose"), palida.vectors.state[1, :6])
    unit.step()
    np.testing.assert_allclose(unit.get(_of_actuators("rest")), palida.vectors.rest[1], atol=1e-9)
    np.testing.assert_array_equal(unit.get(pose), palida.robot.home)
    assert not np.any(unit.get(_of_pose("measured_rate")))
    assert unit.logged == []


@pytest.mark.system("cc")
@pytest.mark.parametrize("spoilt", [(100, 1, 1, 1, 1, 1), (np.nan,) * 6])
def test_lengths_without_a_pose_are_discarded_and_the_next_are_found(palida, unit, spoilt):
    vectors = palida.vectors
    lengths, pose = _of_actuators("measured_lengths"), _of_pose("measured_pose")
    unit.put(lengths, vectors.lengths[1])
    unit.step()
    np.testing.assert_allclose(unit.get(pose), vectors.state[1, :6], atol=1e-9)
    unit.put(lengths, vectors.lengths[1] * spoilt)
    unit.step()
    for names in (pose, _of_pose("measured_rate")):
        with pytest.raises(FMICallException) as failed:
            unit.get(names)
        assert failed.value.status == DISCARD
    assert len(unit.logged) == 1  # once, not each time that it is asked for
    unit.get(_of_actuators("forces"))
    unit.put(lengths, vectors.lengths[2])
    unit.step()
    np.testing.assert_allclose(unit.get(pose), vectors.state[2, :6], atol=1e-9)


@pytest.mark.system("cc")
def test_a_pose_without_forces_is_discarded_and_the_measured_one_is_not(palida, unit):
    unit.put(_of_pose("pose"), np.full(6, np.nan))
    for name in ("forces", "rest", "friction"):
        with pytest.raises(FMICallException) as failed:
            unit.get(_of_actuators(name))
        assert failed.value.status == DISCARD
    assert len(unit.logged) == 1
    np.testing.assert_array_equal(unit.get(_of_pose("measured_pose")), palida.robot.home)


@pytest.mark.system("cc")
def test_the_search_begins_where_it_is_told(palida, unit):
    """Turned by more than 45° from there is too far, and a reset forgets it."""
    lengths, pose, start = (
        _of_actuators("measured_lengths"),
        _of_pose("measured_pose"),
        _of_pose("start_pose"),
    )
    unit.put(start, palida.robot.home + np.eye(6)[5])
    unit.step()
    with pytest.raises(FMICallException) as failed:
        unit.get(pose)
    assert failed.value.status == DISCARD
    unit.put(start, palida.vectors.state[1, :6] + 0.01)
    unit.put(lengths, palida.vectors.lengths[1])
    np.testing.assert_allclose(unit.get(pose), palida.vectors.state[1, :6], atol=1e-9)
    unit.unit.reset()
    np.testing.assert_array_equal(unit.get(pose), palida.robot.home)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_fmus_source_compiles_without_a_warning(fmu, compiler):
    (source,) = fmu[1].glob("sources/*_fmu.c")
    command = [compiler, *FLAGS, "-O0", "-Wshadow", "-fsyntax-only", source.name]
    subprocess.run(command, cwd=source.parent, check=True)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_s_function_compiles_against_a_stand_in_and_gives_the_models_numbers(
    palida, tmp_path, monkeypatch, compiler
):
    monkeypatch.setattr(formats, "find_compiler", lambda: None)  # its own test is that of `c`
    made = FORMATS["simulink"].make(palida, tmp_path)
    for name, content in made.files.items():
        (tmp_path / name).write_bytes(content)
    sources = [f"{palida.prefix}_sfun.c", f"{palida.prefix}.c"]
    command = [compiler, *FLAGS, "-O0", "-Wno-unused-value", "-I", str(HERE), "-shared", "-fPIC"]
    subprocess.run([*command, "-o", "sfun.so", *sources, "-lm"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "sfun.so"))
    # The signals stand first in the stand-in's SimStruct, and what is connected.
    block, vectors = np.zeros(300), palida.vectors
    place = ctypes.c_void_p(block.ctypes.data)
    connected = block[84:].view(np.intc)[:5]
    inputs, outputs = block[:30].reshape(5, 6), block[30:78].reshape(8, 6)
    library.started(place)
    library.called(place)
    np.testing.assert_array_equal(outputs[:6], 0)
    np.testing.assert_array_equal(outputs[6:], [palida.robot.home, np.zeros(6)])
    connected[:] = 1
    for k, state in enumerate(vectors.state[:20]):
        inputs[:3], inputs[3], inputs[4] = state.reshape(3, 6), vectors.lengths[k], vectors.rates[k]
        library.called(place)
        expected = [getattr(vectors, name)[k] for name, *_ in OUTPUTS]
        expected += [vectors.forces[k] * 0.01 / (2 * np.pi), state[:6], state[6:12]]
        np.testing.assert_allclose(outputs, expected, atol=1e-8)
    assert library.failed(place) == 0
    inputs[3] *= 100
    library.called(place)
    assert library.failed(place) == 1


@pytest.mark.parametrize("name", FORMATS)
def test_without_a_compiler_source_is_written_untested_and_no_fmu(
    name, palida, tmp_path, monkeypatch
):
    monkeypatch.setenv("CC", "no-such-compiler")
    if name == "fmu":
        with pytest.raises(ComputationError, match="compiler"):
            FORMATS[name].make(palida, tmp_path)
        return
    made = FORMATS[name].make(palida, tmp_path)
    assert made.files
    assert bool(made.untested) != bool(made.tests)


@pytest.mark.system("cc")
def test_a_model_that_is_wrong_is_not_handed_over(palida, tmp_path):
    """The vectors are those of another machine."""
    wrong = dataclasses.replace(palida)
    vectors = palida.vectors
    wrong.__dict__["vectors"] = dataclasses.replace(vectors, forces=vectors.forces + 1e-6)
    with pytest.raises(ComputationError, match="self-test"):
        FORMATS["python"].make(wrong, tmp_path)


def test_the_same_model_makes_the_same_bytes(palida, tmp_path, monkeypatch):
    monkeypatch.setattr(formats, "find_compiler", lambda: None)
    found = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        found.append(FORMATS["c"].make(palida, tmp_path / name).files)
    assert found[0] == found[1]
