"""Declarations of plug-ins: modules that an installed distribution names in its entry points."""

import textwrap

import pytest

import constraints
from constraints import plugins

MODULE = """
    from constraints import plain_limit

    SWAY = plain_limit("sway", "sway of the TCP", "m", "upper")
    MORE = (SWAY, plain_limit("heave", "heave of the TCP", "m", "upper"))
    _PRIVATE = plain_limit("hidden", "hidden", "m", "upper")


    class Sort(str):
        pass
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a plug-in with limits for the time of a test."""
    (tmp_path / "swaying.py").write_text(textwrap.dedent(MODULE), encoding="utf-8")
    about = tmp_path / "swaying-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: swaying\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nswaying = swaying\n")
    monkeypatch.syspath_prepend(tmp_path)
    caches = plugins.plugin_modules, constraints.limit_definitions
    for one in caches:
        one.cache_clear()
    yield
    for one in caches:
        one.cache_clear()


def test_limits_of_a_plugin_are_limits(installed):
    own = set(constraints.limit_definitions())
    assert {"sway", "heave", "tilt"} <= own
    assert "hidden" not in own


def test_classes_of_a_plugin(installed):
    (found,) = plugins.declared_classes(str)
    assert found.__name__ == "Sort"
    assert plugins.declared_classes(constraints.LimitDefinition) == ()
