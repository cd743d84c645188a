"""What is certified of a motion: never less than what the motion does."""

from dataclasses import replace

import numpy as np
import pytest

import expdesign
from constraints import limit_definitions
from expdesign.enclosure.instructions import NoEnclosureError
from expdesign.enclosure.series import EnclosedSeries
from expdesign.recheck.certificate import certify
from expdesign.robot import LimitModel
from tests.enclosure.motions import drawn


@pytest.fixture(scope="module")
def palida():
    return LimitModel.of(expdesign.load_robot("palida"))


def test_what_no_cell_was_looked_at_for_is_not_certified(palida):
    motion = EnclosedSeries(drawn(palida, np.random.default_rng(1)))

    checks = certify(palida, motion, most=0)

    assert not any(check.certified for check in checks)


def test_a_limit_that_is_computed_in_an_unknown_way_is_refused(palida):
    known = limit_definitions()["jacobian_condition"]
    other = replace(known, numerical=lambda entries: np.sum(entries, axis=1, keepdims=True))
    limits = tuple(
        replace(one, definition=other) if one.definition is known else one for one in palida.limits
    )
    motion = EnclosedSeries(drawn(palida, np.random.default_rng(1)))

    with pytest.raises(NoEnclosureError):
        certify(LimitModel(palida.robot, limits), motion)
