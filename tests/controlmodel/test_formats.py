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
from fmpy.validation import validate_fmu

from estimation.controlmodel import formats
from estimation.controlmodel.compiler import FLAGS
from estimation.controlmodel.formats import FORMATS, OUTPUTS
from estimation.controlmodel.vectors import random_states
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import POSE

HERE = Path(__file__).parent
STATES = ("pose", "rate", "acceleration")


def _module(folder, model):
    path = folder / f"{model.prefix}.py"
    spec = importlib.util.spec_from_file_location(model.prefix, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_python_module_gives_the_robots_numbers(model, tmp_path):
    made = FORMATS["python"].make(model, tmp_path)
    assert [test.precision for test in made.tests] == ["double"]
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


def test_the_python_module_needs_numpy_alone(palida, tmp_path):
    FORMATS["python"].make(palida, tmp_path)
    code = (
        f"import sys; sys.path[:] = [{str(tmp_path)!r}, *sys.path]; import {palida.prefix}; "
        "print(any(name in sys.modules for name in ('casadi', 'scipy', 'expdesign')))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.system("cc")
def test_the_fmu_is_valid_and_gives_the_models_numbers(palida, tmp_path):
    made = FORMATS["fmu"].make(palida, tmp_path)
    (name,) = made.files
    path = tmp_path / name
    path.write_bytes(made.files[name])
    assert validate_fmu(str(path)) == []
    vectors = palida.vectors
    named = [f"{state}.{axis.name}" for state in STATES for axis in POSE]
    given = np.zeros(len(vectors.state), dtype=[("time", float), *((n, float) for n in named)])
    given["time"] = np.arange(len(given))
    for column, values in zip(named, vectors.state.T, strict=True):
        given[column] = values
    outputs = [f"{name}[{j}]" for name, *_ in OUTPUTS for j in range(1, 7)]
    steps = {"stop_time": len(given), "step_size": 1, "output_interval": 1}
    result = fmpy.simulate_fmu(str(path), input=given, output=outputs, **steps)
    for name, *_ in OUTPUTS:
        # What was given at the beginning of a step is there at its end.
        found = np.stack([result[f"{name}[{j}]"] for j in range(1, 7)], axis=1)[1:]
        np.testing.assert_allclose(found, getattr(vectors, name), atol=1e-9, err_msg=name)


@pytest.mark.system("cc")
def test_the_s_function_compiles_against_a_stand_in_and_gives_the_models_numbers(
    palida, tmp_path, monkeypatch
):
    monkeypatch.setattr(formats, "find_compiler", lambda: None)  # its own test is that of `c`
    made = FORMATS["simulink"].make(palida, tmp_path)
    for name, content in made.files.items():
        (tmp_path / name).write_bytes(content)
    sources = [f"{palida.prefix}_sfun.c", f"{palida.prefix}.c"]
    command = ["cc", *FLAGS, "-O0", "-Wno-unused-value", "-I", str(HERE), "-shared", "-fPIC"]
    subprocess.run([*command, "-o", "sfun.so", *sources, "-lm"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "sfun.so"))
    # The signals stand first in the stand-in's SimStruct.
    block = np.zeros(200)
    for k, state in enumerate(palida.vectors.state[:20]):
        block[:18] = state
        library.called(ctypes.c_void_p(block.ctypes.data))
        found = block[18:48].reshape(5, 6)
        for values, (name, *_) in zip(found, OUTPUTS, strict=True):
            expected = getattr(palida.vectors, name)[k]
            np.testing.assert_allclose(values, expected, atol=1e-9, err_msg=name)


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
