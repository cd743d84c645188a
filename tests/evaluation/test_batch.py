"""The virtual machine and machine code evaluate the same graph, to the same last bit."""

import os
import subprocess
import sys
from functools import partial

import casadi as ca
import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.evaluation import machine_code
from expdesign.evaluation.batch import BatchFunction, Graph
from expdesign.evaluation.block_loop import Lanes
from expdesign.evaluation.machine_code import CACHE, SWITCH, VIRTUAL_MACHINE, evaluator
from expdesign.mechanism.term import Friction
from expdesign.robot import LimitModel, load_robot
from expdesign.robot.limit_model import _kernel

UNARY = (
    *(ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.sinh, ca.cosh, ca.tanh, ca.exp),
    *(ca.log, ca.sqrt, ca.fabs, ca.sign, ca.floor, ca.ceil, ca.erf, ca.logic_not),
    *(lambda x: -x, lambda x: x * x, lambda x: 2 * x, lambda x: 1 / x, lambda x: x**3),
)
BINARY = (
    *(ca.plus, ca.minus, ca.times, ca.rdivide, ca.fmin, ca.fmax, ca.atan2, ca.hypot, ca.power),
    *(ca.lt, ca.le, ca.eq, ca.ne, ca.logic_and, ca.logic_or, ca.fmod, ca.copysign),
    lambda x, y: ca.if_else(x < y, x, 3.0),
)
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-310, 1e308]
FEW = 50


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.delenv(SWITCH, raising=False)
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "kernels"


def both(build, *inputs):
    """Return the outputs by the virtual machine, and by machine code."""
    interpreted, compiled = build(), build()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, "virtual-machine")
        expected = interpreted(*inputs)
    compiled.compile()
    assert compiled.is_compiled
    assert not interpreted.is_compiled
    return expected, compiled(*inputs)


def same(found, expected):
    for one, other in zip(found, expected, strict=True):
        assert one.shape == other.shape
        np.testing.assert_array_equal(one, other)


def everything():
    x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p", 2)
    outputs = [one(x) for one in UNARY] + [two(x, y) for two in BINARY]
    outputs.append(ca.horzcat(ca.vertcat(x * p[0], 7.0, 0), ca.vertcat(p[1], y, x)))
    outputs.append(ca.SX(2, 3))
    return BatchFunction(Graph("all", [ca.vertcat(x, y)], [p], outputs))


@pytest.mark.parametrize("lanes", [2, 4, 8])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 1500])
def test_every_operation_of_every_value(count, lanes, monkeypatch):
    # Processors differ in how many numbers a register holds.
    monkeypatch.setattr(machine_code, "_lanes", lambda: Lanes(lanes))
    special = np.stack(np.meshgrid(SPECIAL, SPECIAL), axis=-1).reshape(-1, 2)
    drawn = np.random.default_rng(0).normal(size=(1500, 2))
    varying = np.concatenate([special, drawn, special])[-count or len(drawn) * 2 :]
    same(*both(everything, varying, np.array([0.3, -2.0])))


@pytest.mark.parametrize("lanes", [2, 4, 8])
@pytest.mark.parametrize("sizes", [(1,), (3,), (9,), (1, 1), (3, 2), (5, 1), (1, 0, 1)])
def test_small_functions_with_elements_that_are_zero(sizes, lanes, monkeypatch):
    # Where there are fewer elements than lanes, more is read and written than there is.
    monkeypatch.setattr(machine_code, "_lanes", lambda: Lanes(lanes))

    def sparse():
        inputs = [ca.SX.sym("x", size) for size in sizes]
        first, last, zeros = inputs[0][0], inputs[-1], ca.SX(4, 1)
        outputs = [ca.vertcat(2 * first, ca.SX(1, 1)), ca.vertcat(zeros, first, zeros), last]
        outputs += [ca.SX(3, 3), ca.diag(ca.vertcat(first, first + 1, first**2)), ca.SX(0, 1)]
        return BatchFunction(Graph("sparse", inputs, [], outputs))

    rng = np.random.default_rng(0)
    for count in (1, 3, 8, 17):
        same(*both(sparse, *(rng.normal(size=(count, size)) for size in sizes)))


def test_values_that_wait_for_thousands_of_instructions():
    # What is computed at the beginning is needed at the end, beside what needs it in between.
    def long():
        x = ca.SX.sym("x", 3)
        rng = np.random.default_rng(3)
        values = [x[k] for k in range(3)]
        for _ in range(6000):
            a, b = rng.integers(max(0, len(values) - 900), len(values), 2)
            values.append(ca.sin(values[a]) + values[b] * float(rng.normal()))
        return BatchFunction(Graph("long", [x], [], [ca.vertcat(*values[::37])]))

    same(*both(long, np.random.default_rng(1).normal(size=(21, 3))))


@pytest.mark.parametrize("friction", [Friction.EXACT, Friction.SMOOTH])
def test_limits_of_a_robot(friction):
    robot = load_robot("palida")
    limits = LimitModel.of(robot)
    definitions = tuple(limit.definition for limit in limits.limits)
    assert len(limits.limits) > len(limit_definitions()) / 2
    drawn = np.random.default_rng(1).normal(size=(700, 18))
    states = np.concatenate([robot.home, np.zeros(12)]) + drawn * np.repeat([0.03, 0.5, 5.0], 6)
    fixed = limits._fixed() if friction is Friction.EXACT else limits._fixed(0.02)

    def kernel():
        return BatchFunction(
            partial(_kernel.__wrapped__, definitions, robot.terms, friction, slopes=False)
        )

    same(*both(kernel, states, *fixed))


def test_machine_code_is_made_once_and_a_damaged_one_again(cache):
    x = ca.SX.sym("x", 3)
    inputs = np.arange(6.0).reshape(2, 3)

    def compiled(factor):
        function = BatchFunction(Graph("one", [x], [], [ca.sum1(x) * factor]))
        function.compile()
        return function(inputs)[0][:, 0]

    np.testing.assert_array_equal(compiled(2.0), [6, 24])
    (made,) = cache.iterdir()
    content, first = made.read_bytes(), made.stat().st_ino
    np.testing.assert_array_equal(compiled(2.0), [6, 24])
    assert made.stat().st_ino == first
    for damaged in (b"", content[:-1], content[:100] + bytes([content[100] ^ 1]) + content[101:]):
        made.write_bytes(damaged)
        np.testing.assert_array_equal(compiled(2.0), [6, 24])
        assert made.read_bytes() == content
    np.testing.assert_array_equal(compiled(3.0), [9, 36])
    assert len(list(cache.iterdir())) == 2


def test_without_a_place_for_machine_code(cache):
    cache.parent.write_text("a file where a folder should be")
    x = ca.SX.sym("x", 3)
    function = BatchFunction(Graph("one", [x], [], [x * x]))
    function.compile()
    np.testing.assert_array_equal(function(np.full((2, 3), 3.0))[0], np.full((2, 3), 9.0))


def test_only_who_evaluates_much_compiles(cache):
    x = ca.SX.sym("x", 2)
    function = BatchFunction(Graph("one", [x], [], [ca.cos(x)]))
    for _ in range(3):
        function(np.ones((100, 2)))
    assert not any(cache.glob("*"))
    function(np.ones((5000, 2)))
    assert function.is_compiled
    # Others find it there.
    other = BatchFunction(Graph("one", [x], [], [ca.cos(x)]))
    other(np.ones((100, 2)))
    assert other.is_compiled


def test_the_virtual_machine_alone(monkeypatch):
    assert VIRTUAL_MACHINE not in evaluator()
    monkeypatch.setenv(SWITCH, "virtual-machine")
    assert evaluator() == VIRTUAL_MACHINE


def test_the_virtual_machine_evaluates_where_machine_code_cannot_be_loaded(monkeypatch):
    def fail(*_):
        raise RuntimeError("no memory may be executed")

    monkeypatch.setattr(machine_code, "_entry_address", fail)
    machine_code._is_loadable.cache_clear()
    try:
        assert evaluator() == VIRTUAL_MACHINE
        x = ca.SX.sym("x", 2)
        function = BatchFunction(Graph("one", [x], [], [2 * x]), "key")
        function.compile()
        assert function(np.ones((5000, 2)))[0][-1, 1] == 2
    finally:
        machine_code._is_loadable.cache_clear()


def test_a_function_that_calls_another_is_left_to_the_virtual_machine():
    x = ca.SX.sym("x")
    function = BatchFunction(Graph("one", [x], [], [ca.erfinv(x)]))
    function.compile()
    assert not function.is_compiled
    np.testing.assert_array_equal(function(np.zeros((3, 1)))[0], np.zeros((3, 1)))


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("count", [1, 513])
def test_inputs_of_another_size_are_refused(count, compiled):
    x, y, p = ca.SX.sym("x", 3), ca.SX.sym("y", 2), ca.SX.sym("p", 2)
    function = BatchFunction(Graph("some", [x, y], [p], [ca.sum1(x) * y * p]))
    if compiled:
        function.compile()
    assert function.is_compiled == compiled
    good = np.ones((count, 3)), np.ones((count, 2)), np.ones(2)
    np.testing.assert_array_equal(function(*good)[0], np.full((count, 2), 3.0))
    others = (
        (np.ones((count, 1)), *good[1:]),
        (*good[:2], np.ones(1)),
        # Inputs of another number of samples, more or fewer than the first one's.
        (good[0], np.ones((count + 1, 2)), good[2]),
        (good[0], np.ones((count - 1, 2)), good[2]),
        (np.ones((0, 3)), *good[1:]),
    )
    for inputs in others:
        with pytest.raises(ValueError, match="values, not"):
            function(*inputs)
    for inputs in (good[:1], good[:2], (*good, np.ones(2))):
        with pytest.raises(ValueError, match=f"{len(inputs)} inputs, not 3"):
            function(*inputs)


@pytest.mark.slow
def test_processes_that_compile_the_same_at_once(cache):
    code = (
        "import casadi as ca, numpy as np\n"
        "from expdesign.evaluation.batch import BatchFunction, Graph\n"
        "x = ca.SX.sym('x', 2)\n"
        "function = BatchFunction(Graph('one', [x], [], [ca.sin(x)]))\n"
        "function.compile()\n"
        "assert np.array_equal(function(np.ones((9, 2)))[0], np.sin(np.ones((9, 2))))\n"
    )
    started = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [one.wait() for one in started] == [0, 0, 0]
    assert len(list(cache.iterdir())) == 1


def compile_three():
    x = ca.SX.sym("x", 3)
    function = BatchFunction(Graph("three", [x], [], [3 * ca.sum1(x)]))
    function.compile()
    np.testing.assert_array_equal(function(np.ones((2, 3)))[0][:, 0], [9, 9])


OTHER_USER = 12345


def give_away(place):
    os.chown(place, OTHER_USER, -1)


def let_all_write(place):
    place.chmod(0o777)


def let_all_write_above(folder):
    folder.parent.chmod(0o777)


@pytest.mark.parametrize("forge", [give_away, let_all_write, let_all_write_above])
def test_a_cache_that_others_write_to_is_not_used(forge, cache):
    if forge is give_away and os.geteuid() != 0:
        pytest.skip("only root can give a file away")
    compile_three()
    forge(cache)
    before = {file.name: file.stat().st_mtime_ns for file in cache.iterdir()}
    compile_three()
    own = machine_code._folder()
    assert own != cache
    assert list(own.iterdir())
    assert own.parent.stat().st_mode & 0o777 == 0o700
    assert {file.name: file.stat().st_mtime_ns for file in cache.iterdir()} == before
    warning = machine_code.cache_warning()
    assert str(cache.parent) in warning
    assert "belongs to the user 12345" in warning or "may be written to by others" in warning
    assert machine_code.cache_warning() == ""


def leave(place):
    assert place.is_file()


@pytest.mark.parametrize("forge", [give_away, let_all_write, leave])
def test_a_file_that_others_may_write_to_is_made_again(forge, cache):
    compile_three()
    (made,) = cache.iterdir()
    content, first = made.read_bytes(), made.stat().st_ino
    try:
        forge(made)
    except PermissionError:
        pytest.skip("only root can give a file away")
    compile_three()
    assert (made.stat().st_ino != first) is (forge is not leave)
    assert made.read_bytes() == content
    assert (made.stat().st_uid, made.stat().st_mode & 0o777) == (os.geteuid(), 0o600)


def test_a_link_or_a_pipe_in_the_cache_is_replaced(cache, tmp_path):
    compile_three()
    (made,) = cache.iterdir()
    elsewhere = made.rename(tmp_path / "elsewhere")
    for place in (lambda: made.symlink_to(elsewhere), lambda: os.mkfifo(made)):
        made.unlink(missing_ok=True)
        place()
        compile_three()
        assert made.is_file()
        assert not made.is_symlink()


def test_a_process_compiles_where_others_write_to_every_folder(tmp_path):
    places = {name: tmp_path / name for name in (CACHE, "TMPDIR")}
    for place in places.values():
        place.mkdir()
        place.chmod(0o777)
    code = "from expdesign.evaluation.machine_code import cache_warning; print(cache_warning())"
    environment = os.environ | {name: str(place) for name, place in places.items()}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "may be written to by others" in done.stdout
    assert not list(places["TMPDIR"].iterdir()), "the process's own folder goes with it"
