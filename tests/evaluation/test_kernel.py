"""Kernels are known by what they are made of: a graph is made only where there is no code of it."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from constraints import limit_definitions, limits
from expdesign.evaluation import kernel as module
from expdesign.evaluation.batch import Graph
from expdesign.evaluation.kernel import kernel
from expdesign.evaluation.machine_code import CACHE, SWITCH
from expdesign.mechanism.catalogue import term_definitions, terms_named
from expdesign.mechanism.term import Friction

X = np.arange(6.0).reshape(2, 3)


@pytest.fixture(autouse=True)
def settled(tmp_path, monkeypatch):
    """A cache of its own, in a process that began after the last change of the sources."""
    monkeypatch.delenv(SWITCH, raising=False)
    monkeypatch.setenv(CACHE, str(tmp_path))
    monkeypatch.setattr(module, "_BEGAN", np.inf)
    yield
    module._files.cache_clear()
    module._hashed.cache_clear()


def stated(factor=2.0):
    """Return a statement of a graph, and the arguments that it was made with."""
    made = []

    def scaled(*arguments):
        made.append(arguments)
        x = ca.SX.sym("x", 3)
        return Graph("scaled", [x], [], [ca.sum1(x) * factor])

    return scaled, made


def evaluated(state, *arguments):
    function = kernel(state)(*arguments)
    function.compile()
    return function(X)[0][:, 0]


TERM, LIMIT = term_definitions()["struts"], limit_definitions()["strut_length"]


@pytest.mark.parametrize(
    "argument", [TERM, LIMIT, (TERM, LIMIT), (), True, "text", Friction.SMOOTH]
)
def test_the_graph_is_made_once_for_all_processes(argument):
    scaled, made = stated()
    for _ in range(3):
        np.testing.assert_array_equal(evaluated(scaled, argument), [6, 24])
    assert made == [(argument,)]


def test_another_argument_is_another_graph():
    scaled, made = stated()
    arguments = [(TERM,), (LIMIT,), (TERM, LIMIT), *((form,) for form in (True, False, "True"))]
    arguments += [
        (terms,)
        for terms in (
            terms_named(["struts", "rigid_platform"], general=True),
            terms_named(["struts", "rigid_platform"], general=False),
            terms_named(["drive_inertia"], general=True),
            terms_named(["drive_inertia"], general=True, turning=True),
        )
    ]
    for each in arguments:
        evaluated(scaled, *each)
    assert made == arguments


@pytest.mark.parametrize("own", [replace(TERM, meaning="mine"), replace(LIMIT, title="mine"), 2.5])
def test_what_is_in_no_catalogue_has_no_name(own):
    # Its functions are not told apart by where they stand: a graph of before is not its own.
    first, made = stated(2.0)
    np.testing.assert_array_equal(evaluated(first, own), [6, 24])
    other, more = stated(3.0)
    np.testing.assert_array_equal(evaluated(other, own), [9, 36])
    assert len(made) == len(more) == 1


def test_sources_that_have_just_changed_give_no_name(monkeypatch):
    # What runs may be what was there before.
    evaluated(stated()[0], TERM)
    monkeypatch.setattr(module, "_BEGAN", 0)
    np.testing.assert_array_equal(evaluated(stated(3.0)[0], TERM), [9, 36])


def test_a_limit_in_a_folder_of_the_users(monkeypatch, tmp_path):
    folder = tmp_path / "limits"
    folder.mkdir()
    monkeypatch.setattr(limits, "__path__", [*limits.__path__, str(folder)])
    for factor in (2.0, 3.0):
        (folder / "own.py").write_text(f"FACTOR = {factor}")
        module._hashed.cache_clear()  # as in another process
        module._files.cache_clear()
        np.testing.assert_array_equal(evaluated(stated(factor)[0], LIMIT), factor * X.sum(axis=1))
    # An editor's: a link to nowhere.
    (folder / ".#own.py").symlink_to(folder / "nowhere")
    module._files.cache_clear()
    np.testing.assert_array_equal(evaluated(stated(4.0)[0], LIMIT), 4.0 * X.sum(axis=1))


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
