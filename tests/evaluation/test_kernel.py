"""Kernels are keyed by their content: a graph is made only where there is no machine code of it."""

import enum
import functools
import itertools
import pickle
import subprocess
import sys
import types
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.evaluation import machine_code
from expdesign.evaluation.batch import Graph, kernel
from expdesign.evaluation.content import content_key
from expdesign.evaluation.machine_code import CACHE, SWITCH
from expdesign.mechanism.term import Friction
from expdesign.mechanism.terms import term_definitions, terms_named
from expdesign.problem import objective
from expdesign.robot import limit_model, robot

X = np.arange(6.0).reshape(2, 3)
TERM, LIMIT = term_definitions()["struts"], limit_definitions()["strut_length"]


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """A cache of its own."""
    monkeypatch.delenv(SWITCH, raising=False)
    monkeypatch.setenv(CACHE, str(tmp_path))


def stated(factor=2.0):
    """Return a statement of a graph."""

    def scaled(*_):
        x = ca.SX.sym("x", 3)
        return Graph("scaled", [x], [], [ca.sum1(x) * factor])

    return scaled


def evaluate(state, *arguments):
    """Return values of a new kernel, and whether its graph was made for them."""
    function = kernel(state)(*arguments)
    function.compile()
    values = function(X)[0][:, 0]
    return values, "_graph" in vars(function)


@pytest.mark.parametrize(
    "argument", [TERM, LIMIT, (TERM, LIMIT), (), True, "text", 2.5, Friction.SMOOTH]
)
def test_the_graph_is_made_once_for_all_processes(argument):
    made = []
    for _ in range(3):
        values, is_made = evaluate(stated(), argument)
        np.testing.assert_array_equal(values, [6, 24])
        made.append(is_made)
    assert made == [True, False, False]


def test_other_arguments_have_other_keys():
    arguments = [(TERM,), (LIMIT,), (TERM, LIMIT), True, False, "True", 1, 1.0, 0.0, -0.0, None]
    arguments += [
        terms_named(["struts", "rigid_platform"], general=True),
        terms_named(["struts", "rigid_platform"], general=False),
        terms_named(["drive_inertia"], general=True),
        terms_named(["drive_inertia"], general=True, turning=True),
        *(np.array([0.0, 1.0]), np.array([[0.0, 1.0]]), Friction.SMOOTH, Friction.EXACT),
    ]
    keys = [content_key(argument) for argument in arguments]
    assert None not in keys
    assert len(set(keys)) == len(arguments)


def test_a_term_or_limit_that_is_in_no_catalogue_has_a_key_of_its_content():
    def doubled(values):
        return 2 * values

    for own in (TERM, LIMIT):
        assert content_key(replace(own)) == content_key(own)
    assert content_key(replace(LIMIT, natural=doubled)) != content_key(LIMIT)
    first, is_made = evaluate(stated(2.0), replace(LIMIT, natural=doubled))
    other, is_made_again = evaluate(stated(3.0), replace(LIMIT, natural=doubled))
    assert is_made
    assert is_made_again
    np.testing.assert_array_equal(first * 1.5, other)


SOURCE = '''
import casadi as ca
import numpy as np
from expdesign.evaluation.batch import Graph

FACTOR = 2.0
UNUSED = 1.0


class Scale:
    """A scale."""

    power = 1

    def apply(self, x):
        """Return the scaled value."""
        # a comment
        return FACTOR * x**self.power


def helper(x):
    return Scale().apply(x)


def unused(x):
    return 7 * x


def state(*_):
    """State the graph."""

    def inner(x):
        """Return the helper's value."""
        return helper(x)

    x = ca.SX.sym("x", 3)
    return Graph("scaled", [x], [], [ca.sum1(inner(x))])
'''


def module_of(source):
    """Return what a source defines, as in another process that has imported it."""
    module = types.ModuleType("edited")
    exec(compile(source, "edited.py", "exec"), vars(module))
    return module


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# a comment", "# another\n        # comment"),
        ('"""Return the scaled value."""', '"""Return it."""\n'),
        ('"""A scale."""', '"""A factor, and\n    its power."""'),
        ('"""State the graph."""', '"""State it."""'),
        ('"""Return the helper\'s value."""', '"""Return a value."""'),
        ("\ndef helper", "\n\n# moved\n\n\ndef helper"),
        ("UNUSED = 1.0", "UNUSED = 2.0"),
        ("return 7 * x", "return 8 * x"),
    ],
)
def test_documentation_and_unused_code_are_not_in_the_key(old, new):
    assert old in SOURCE
    before, after = (module_of(source).state for source in (SOURCE, SOURCE.replace(old, new)))
    assert content_key(after) == content_key(before)
    assert [evaluate(state)[1] for state in (before, after)] == [True, False]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FACTOR = 2.0", "FACTOR = 3.0"),
        ("power = 1", "power = 2"),
        ("FACTOR * x**self.power", "FACTOR + x**self.power"),
        ("return Scale().apply(x)", "return 2 * Scale().apply(x)"),
        ("return helper(x)", "return helper(-x)"),
        ("ca.sum1(", "ca.sumsqr("),
        ("def apply(self, x):", "def apply(self, x, more=1):"),
    ],
)
def test_code_and_data_that_are_used_are_in_the_key(old, new):
    assert old in SOURCE
    before, after = (module_of(source).state for source in (SOURCE, SOURCE.replace(old, new)))
    assert content_key(after) != content_key(before)
    assert [evaluate(state)[1] for state in (before, after)] == [True, True]


def test_defaults_closures_and_decorated_functions_are_in_the_key():
    def made(factor):
        @functools.cache
        def cached(x):
            return factor * x

        return [
            cached,
            lambda x, f=factor: f * x,
            lambda x: factor * x,
            functools.partial(pow, exp=factor),
            frozenset({"a", str(factor)}),
            {"a": factor},
        ]

    for one, same, other in zip(made(2), made(2), made(3), strict=True):
        assert content_key(one) == content_key(same) is not None
        assert content_key(one) != content_key(other)


def test_content_that_is_not_known_has_no_key():
    class Counter:
        pass

    @dataclass(frozen=True)
    class Holder:
        part: object

    class Kind(enum.Enum):
        ONE = Counter

    counter = Counter()
    for unknown in (counter, [counter], Holder(counter), lambda: counter, itertools.count()):
        assert content_key(unknown) is None
    assert content_key(Holder(1)) not in {None, content_key(Holder(2))}
    assert content_key(Kind.ONE) is not None

    def imports():
        import expdesign.motion.planning

        return expdesign.motion.planning

    assert content_key(imports) is None
    # It is evaluated all the same.
    np.testing.assert_array_equal(evaluate(lambda *_: stated(3.0)(counter))[0], [9, 36])


KEYS = """
from tests.evaluation.test_kernel import project_keys
print(*project_keys(), sep="\\n")
"""


def project_keys():
    """Return the keys of the project's kernels for its terms and limits."""
    terms = terms_named(["struts", "rigid_platform", "actuator_friction"], general=True)
    kernels = [
        *(
            objective._factor_kernel,
            objective._slope_kernel,
            objective._gradient_kernel,
        ),
        *(robot._regressor_kernel, robot._force_kernel, limit_model._kernel),
    ]
    parts = (terms, tuple(limit_definitions().values()))
    return [*(content_key(one.__wrapped__, parts) for one in kernels), machine_code._emitter()]


def test_the_projects_kernels_have_the_same_keys_in_other_processes():
    keys = project_keys()
    assert "None" not in map(str, keys)
    assert len(set(keys)) == len(keys)
    for seed in ("1", "2"):
        found = subprocess.run(
            [sys.executable, "-c", KEYS],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(path for path in sys.path if path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert found.stdout.split() == keys


def test_terms_of_the_catalogue_stay_the_same_in_other_processes():
    forms = (False, True)
    every = [
        terms_named(term_definitions(), general=general, turning=turning)
        for general in forms
        for turning in forms
    ]
    for terms in every:
        copied = pickle.loads(pickle.dumps(terms))
        assert all(one is other for one, other in zip(copied, terms, strict=True))
    own = replace(TERM, meaning="mine")
    copied = pickle.loads(pickle.dumps(own))
    assert (copied.meaning, copied.columns) == ("mine", TERM.columns)
