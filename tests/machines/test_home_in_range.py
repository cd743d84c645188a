"""Ranges of a file that its own home is not in."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.machines.importing import drop_contradicting_ranges, move_to_mid_stroke
from expdesign.machines.machine import MachineDraft
from tests.machines import simulated
from tests.machines.machines_of import asked
from tests.machines.machines_of import lengths as lengths_at

HOME = (*simulated.POSITION.tolist(), 0.0, 0.1, 0.0)


def machine(**limits):
    base, platform = (tuple(map(tuple, points)) for points in (simulated.BASE, simulated.PLATFORM))
    return MachineDraft("m", base_joints=base, platform_joints=platform, home=HOME, limits=limits)


def test_what_home_keeps_stays_as_it_is():
    one = machine(strut_length=(0.5, 1.0), position={"z": (0.7, 0.8)})
    assert drop_contradicting_ranges(one) == one
    assert drop_contradicting_ranges(MachineDraft("m", limits={"strut_length": (0.0, 0.1)})).limits


def test_components_that_home_breaks_are_asked_about_alone():
    one = machine(position={"x": (0.1, 0.2), "z": (0, 1)}, rotation={"theta": (-0.1, 0.05)})
    found = drop_contradicting_ranges(one)
    assert found.limits == {"position": {"z": (0, 1)}}
    assert asked(found) == {"limits.position", "limits.rotation"}


def test_lengths_counted_from_elsewhere_are_asked_about():
    found = drop_contradicting_ranges(machine(strut_length=(0.0, 0.3)))
    assert "strut_length" not in found.limits
    assert asked(found) == {"limits.strut_length"}


def test_an_end_that_home_misses_by_its_digits_is_moved():
    rest = drop_contradicting_ranges(machine(strut_length=((0.5, 1.0),) * 6))
    assert rest.limits["strut_length"] == ((0.5, 1.0),) * 6
    base, platform = np.array(rest.base_joints), np.array(rest.platform_joints)
    turned = np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])
    home = np.linalg.norm(HOME[:3] + platform @ turned.T - base, axis=1)
    pairs = tuple((length + 1e-6, 1.0) for length in home.tolist())
    found = drop_contradicting_ranges(machine(strut_length=pairs))
    np.testing.assert_allclose(found.limits["strut_length"], [(h, 1.0) for h in home], atol=1e-12)
    assert not found.questions


def test_a_home_at_the_end_of_the_stroke_is_moved_to_its_middle():
    lengths = simulated.LENGTHS
    base, platform = (tuple(map(tuple, points)) for points in (simulated.BASE, simulated.PLATFORM))
    home = (*simulated.POSITION, *np.radians([4, -3, 6]))
    retracted = MachineDraft("m", base_joints=base, platform_joints=platform, home=home)
    for low, high in ((0.0, 0.3), (-0.3, 0.0)):
        limits = {"strut_length": tuple(zip(lengths + low, lengths + high, strict=True))}
        found = move_to_mid_stroke(replace(retracted, limits=limits))
        assert asked(found) == {"home"}
        np.testing.assert_array_equal(np.delete(found.home, 2), np.delete(home, 2))
        middle = np.mean(lengths_at(found, found.home))
        assert middle == pytest.approx(np.mean(lengths) + (low + high) / 2, abs=1e-4)
    # One with room to move, and one that the range of z holds, stay.
    for given in ({"strut_length": (0.5, 1.0)}, limits | {"position": {"z": (0.65, 0.75)}}):
        one = replace(retracted, limits=given)
        assert move_to_mid_stroke(one) == one
