import importlib
import pickle
import sys

import numpy as np
import pytest

from constraints import limit_definitions, limits
from expdesign.configuration import InputError
from expdesign.configuration.robot import load_robot_description
from expdesign.motion.planning import STRUT_JERK
from expdesign.robot import LimitModel, robot_from

NEW = """\
from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="beta_rate",
    title="rate of β",
    unit="rad/s",
    kind="symmetric",
    per_actuator=True,
    requires=("beta_rate",),
    natural=lambda q: q["beta_rate"],
)
"""


@pytest.fixture
def add_file(tmp_path, monkeypatch):
    """Return a function that drops a file into the folder of limits."""
    before = set(sys.modules)
    monkeypatch.setattr(limits, "__path__", [*limits.__path__, str(tmp_path)])

    def add(name, text):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
        importlib.invalidate_caches()
        limit_definitions.cache_clear()

    yield add
    monkeypatch.undo()
    limit_definitions.cache_clear()
    for name in set(sys.modules) - before:
        if name.startswith(f"{limits.__name__}."):
            del sys.modules[name]
            vars(limits).pop(name.rpartition(".")[2], None)


def test_keys_are_those_of_the_definitions():
    for key, definition in limit_definitions().items():
        assert key == definition.key


def test_a_file_is_all_that_a_limit_needs(add_file):
    before = dict(limit_definitions())
    add_file("zz_beta_rate", NEW)
    definitions = limit_definitions()
    assert set(definitions) == {*before, "beta_rate"}
    assert all(definitions[key] is definition for key, definition in before.items())


def test_a_new_limit_works_from_the_robot_file_to_the_check(add_file, tmp_path):
    add_file("zz_beta_rate", NEW)
    source = load_robot_description("palida").source.read_text(encoding="utf-8")
    file = tmp_path / "mine.yaml"
    file.write_text(source + "  beta_rate: 90 deg/s\n", encoding="utf-8")
    robot = robot_from(load_robot_description(file))
    limit = next(limit for limit in robot.limits if limit.key == "beta_rate")
    np.testing.assert_allclose([-limit.lower, limit.upper], np.pi / 2)
    assert limit.labels == tuple(f"strut {j}" for j in range(1, 7))
    assert limit.origin == "mine.yaml: limits.beta_rate"
    rng = np.random.default_rng(0)
    states = np.concatenate([np.tile(robot.home, (9, 1)), rng.normal(size=(9, 12))], axis=1)
    values = LimitModel(robot, (limit,)).values(states)
    motion = robot.strut_motion(states[:, :6], states[:, 6:12], states[:, 12:])
    np.testing.assert_allclose(values, motion.beta_rate, rtol=1e-12)


FOLDED = """\
import numpy as np
from constraints.definition import LimitDefinition

LIMIT = LimitDefinition(
    key="folded",
    title="folded β",
    unit="rad",
    kind="KIND",
    per_actuator=True,
    requires=("beta_rate",),
    natural=lambda q: q["beta_rate"],
    transform=TRANSFORM,
)
"""


@pytest.mark.parametrize(
    ("kind", "transform", "bounds", "is_unique"),
    [
        ("interval", "np.sin", "[-80 deg, 20 deg]", True),
        ("interval", "np.sin", "[-100 deg, 20 deg]", False),
        ("symmetric", "np.tan", "80 deg", True),
        ("symmetric", "np.tan", "100 deg", False),
        ("upper", "lambda x: np.sin(x) ** 2", "80 deg", True),
        ("upper", "lambda x: np.sin(x) ** 2", "100 deg", False),
        ("upper", "lambda x: np.sin(x) ** 2", "200 deg", False),
        ("lower", "np.log", "10 deg", True),
        ("upper", "np.log", "10 deg", True),
        ("symmetric", "np.log", "10 deg", False),
    ],
)
def test_a_bound_beyond_the_unique_range_of_a_new_limit_is_refused(
    add_file, tmp_path, kind, transform, bounds, is_unique
):
    add_file("zz_folded", FOLDED.replace("KIND", kind).replace("TRANSFORM", transform))
    source = load_robot_description("palida").source.read_text(encoding="utf-8")
    file = tmp_path / "mine.yaml"
    file.write_text(f"{source}  folded: {bounds}\n", encoding="utf-8")
    if is_unique:
        assert "folded" in load_robot_description(file).limits
    else:
        with pytest.raises(InputError) as refused:
            load_robot_description(file)
        (problem,) = refused.value.problems
        assert (problem.file, problem.key) == (file, "limits.folded")


def test_a_file_without_a_limit_adds_none(add_file):
    before = set(limit_definitions())
    add_file("zz_other", "LIMIT = 3\n")
    assert set(limit_definitions()) == before


def test_a_key_that_is_taken_is_named(add_file):
    add_file("zz_again", NEW.replace('"beta_rate",\n    title', '"beta",\n    title'))
    with pytest.raises(ValueError, match="beta"):
        limit_definitions()


def test_the_order_is_that_of_the_keys(add_file):
    add_file("aa_first", NEW)
    assert list(limit_definitions()) == sorted(limit_definitions())


def test_a_file_may_declare_several(add_file):
    before = dict(limit_definitions())
    add_file("zz_two", NEW.replace("LIMIT =", "ONE =") + "LIMITS = (ONE,)\n")
    assert set(limit_definitions()) == {*before, "beta_rate"}


def test_constraints_know_no_other_package():
    for name in ("constraints", "constraints.definition"):
        module = importlib.import_module(name)
        for value in vars(module).values():
            owner = getattr(value, "__module__", None) or ""
            assert not owner.startswith(("expdesign", "estimation", "results"))


def test_limits_of_a_robot_follow_the_catalogue():
    limits = load_robot_description("palida").limits
    assert list(limits) == [key for key in limit_definitions() if key in limits]
    assert all(limit.definition is limit_definitions()[key] for key, limit in limits.items())


def test_struts_that_share_a_joint_keep_no_clearance():
    limit = load_robot_description("linuxcnc").limits["strut_clearance"]
    free = [label for label, low in zip(limit.labels, limit.lower, strict=True) if np.isinf(low)]
    assert free == ["struts 1-6", "struts 2-3", "struts 4-5"]


def test_limits_reach_a_worker_process():
    limits = load_robot_description("palida").limits
    for key, limit in pickle.loads(pickle.dumps(limits)).items():
        assert limit.definition is limits[key].definition
        np.testing.assert_array_equal(limit.lower, limits[key].lower)
    # It is in no catalogue: what a robot is moved by from rest.
    assert pickle.loads(pickle.dumps(STRUT_JERK)) is STRUT_JERK
