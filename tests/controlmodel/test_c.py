"""The C code: compiled without a warning by two compilers, for two precisions, and run."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from estimation.controlmodel.formats import FLAGS, FORMATS
from estimation.controlmodel.model import SINGLE, random_states
from expdesign.mechanism.term import Friction

QUICK = (*(flag for flag in FLAGS if flag != "-O2"), "-O0")
STRICT = (*QUICK, "-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes")
PRECISIONS = {"double": (), "float": ("-DEXPDESIGN_FLOAT", "-Wdouble-promotion")}
COMPILERS = [pytest.param(name, marks=pytest.mark.system(name)) for name in ("gcc", "clang")]
NOT_FINITE = 4
pytestmark = pytest.mark.system("cc")


@pytest.fixture(scope="module")
def written(model, tmp_path_factory):
    """A folder with the files of a model; they were compiled and tested by then."""
    folder = tmp_path_factory.mktemp("c")
    made = FORMATS["c"].make(model, folder)
    assert {test.precision for test in made.tests} == {"double", "float"}
    return folder, made


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_it_compiles_without_warnings_and_tests_itself(
    written, model, compiler, precision, tmp_path
):
    folder, program = written[0], tmp_path / "program"
    objects = [str(tmp_path / f"{number}.o") for number in range(2)]
    single, *strict = PRECISIONS[precision] or ("-DEXPDESIGN_DOUBLE",)
    for source, target, flags in zip(
        (f"{model.prefix}.c", f"{model.prefix}_selftest.c"),
        objects,
        ((*STRICT, *strict), QUICK),
        strict=True,
    ):
        command = [compiler, *flags, single, "-c", "-o", target, source]
        subprocess.run(command, cwd=folder, check=True)
    subprocess.run([compiler, "-o", program, *objects, "-lm"], check=True)
    run = subprocess.run([program, "--untimed"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout
    assert model.prefix in run.stdout


def test_a_changed_number_fails_the_self_test(written, model, tmp_path):
    _, made = written
    for name, content in made.files.items():
        (tmp_path / name).write_bytes(content)
    source = tmp_path / f"{model.prefix}.c"
    text = source.read_text(encoding="utf-8")
    mass = f"{float(model.robot.parameters[model.robot.parameter_names.index('p10')])!r}"
    assert text.count(f"R({mass})") == 1
    source.write_text(text.replace(f"R({mass})", "R(17.0)"), encoding="utf-8")
    command = ["make", "-s", f"CFLAGS={' '.join(QUICK)}"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "FAILED" in run.stdout


class _Library:
    """The compiled functions, for NumPy."""

    def __init__(self, folder, prefix, precision):
        name = f"{prefix}-{precision}.so"
        command = ["cc", *QUICK, *PRECISIONS[precision][:1], "-shared", "-fPIC", "-o", name]
        subprocess.run([*command, f"{prefix}.c", "-lm"], cwd=folder, check=True)
        self._library, self._prefix = ctypes.CDLL(str(folder / name)), prefix
        self.type = np.dtype({"double": np.float64, "float": np.float32}[precision])

    def __call__(self, name, *inputs):
        """Return status and six numbers, each an array like the inputs (N, 6)."""
        given = [np.ascontiguousarray(each, self.type) for each in inputs]
        found, status = np.empty_like(given[0]), np.empty(len(given[0]), dtype=int)
        function = getattr(self._library, f"{self._prefix}_{name}")
        for k in range(len(found)):
            places = [ctypes.c_void_p(each[k].ctypes.data) for each in (*given, found)]
            status[k] = function(*places)
        return status, found.astype(float)


@pytest.fixture(scope="module", params=PRECISIONS)
def library(request, written, model):
    return _Library(written[0], model.prefix, request.param), request.param


def test_states_of_its_own_give_the_robots_forces(library, model):
    """At other states than the vectors."""
    compiled, precision = library
    states = random_states(model.robot, 500, 7)
    status, found = compiled("forces", *np.split(states, 3, axis=1))
    assert not np.any(status)
    inputs = (model.robot.machine, model.robot.parameters)
    expected = model.robot.actuator_forces(*np.split(states, 3, axis=1))
    if model.width:
        graph = model.robot.graph
        smooth = ca.Function(
            "smooth",
            [graph.state, graph.machine, graph.parameters, graph.width],
            [graph.force_with(Friction.SMOOTH)],
        )
        expected = np.array([smooth(s, *inputs, model.width).full().ravel() for s in states])
    allowed = 1e-9 if precision == "double" else SINGLE * model.largest_force
    np.testing.assert_allclose(found, expected, atol=allowed)


def test_the_pose_of_lengths_is_found_from_afar(library, model):
    compiled, precision = library
    pose = random_states(model.robot, 200, 8)[:, :6]
    lengths = model.robot.inverse_kinematics(pose)
    status, found = compiled("pose", lengths, np.tile(model.robot.home, (len(pose), 1)))
    assert np.all((status == 0) | (status == 3))
    assert np.mean(status == 0) > 0.9
    reached = status == 0
    allowed = 1e-9 if precision == "double" else 1e-4
    np.testing.assert_allclose(found[reached], pose[reached], atol=allowed)


INPUTS = {
    "forces": 3,
    "rest": 1,
    "friction": 3,
    "lengths": 1,
    "rates": 2,
    "pose": 2,
    "pose_rate": 2,
}


def test_arguments_that_are_not_finite_have_a_status_and_zeros(library, model):
    """Every argument of every function, in each of its six numbers."""
    compiled, _ = library
    wrong = np.concatenate(
        [np.where(np.eye(6, dtype=bool), value, 0.1) for value in (np.nan, np.inf, -np.inf)]
    )
    home = np.tile(model.robot.home, (len(wrong), 1))
    for name, count in INPUTS.items():
        for k in range(count):
            arguments = [home] * count
            arguments[k] = wrong
            status, found = compiled(name, *arguments)
            assert np.all(status == NOT_FINITE), name
            if name != "pose":
                assert not np.any(found), name


def test_extreme_calls_that_return_ok_have_finite_results(library):
    compiled, _ = library
    rng = np.random.default_rng(0)
    largest = np.log10(np.finfo(compiled.type).max)
    for name, count in INPUTS.items():
        exponents = rng.uniform(-largest, largest, (count, 2000, 6))
        arguments = rng.choice([-1, 0, 1], exponents.shape) * 10.0**exponents
        status, found = compiled(name, *arguments)
        assert np.all(np.isfinite(found[status == 0])), name
