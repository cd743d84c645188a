"""What is certified of a motion: never less than what the motion does."""

from dataclasses import replace

import numpy as np
import pytest

from constraints import Limit, limit_definitions
from expdesign.configuration.limits import row_labels
from expdesign.enclosure.instructions import NoEnclosureError
from expdesign.enclosure.limit_rows import EnclosedLimits
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.recheck.certificate import Sharing, bound_cells, certify, share_cells
from expdesign.recheck.limit_check import TOLERANCE
from expdesign.robot import LimitModel
from tests.enclosure.machines import ALL, STICKY, THREADED, robot
from tests.enclosure.motions import (
    drawn,
    highest,
    larger,
    lowered,
    near_limits,
    spiked,
    states,
    with_jerk,
)

POINTS = 20_000
ROUNDED = 1e-11
"""Of a sampled value, as a share of a limit's range."""
SPARE = 1e-3


@pytest.fixture(scope="module")
def palida():
    return LimitModel.of(robot("palida"))


def assert_no_less_than_found(checks, found):
    for check, moment in zip(checks, found, strict=True):
        assert moment.excess <= check.proved + ROUNDED, check.key


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_a_motion_that_leaves_room_is_certified_and_no_sample_exceeds_what_is_proved(name):
    limits = LimitModel.of(robot(name))
    rng = np.random.default_rng(5)
    motion = near_limits(limits, drawn(limits, rng), 2 * SPARE)
    limits = with_jerk(limits, motion, 2 * SPARE)

    checks = certify(limits, EnclosedSeries(motion))

    found = highest(limits, motion, POINTS)
    assert max(moment.excess for moment in found) <= -SPARE
    assert_no_less_than_found(checks, found)
    assert all(check.certified for check in checks)
    for check, moment in zip(checks, found, strict=True):
        assert check.proved == pytest.approx(moment.excess, abs=1e-6)
        assert check.violation <= check.proved


@pytest.mark.parametrize(("cells", "most"), [(4, 1), (64, 200), (512, 512), (300, 4000)])
@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_what_is_proved_holds_however_few_cells_there_are(palida, cells, most, factor):
    rng = np.random.default_rng(cells)
    motion = larger(near_limits(palida, drawn(palida, rng), 0.0), factor)

    checks = certify(palida, EnclosedSeries(motion), cells=cells, most=most)

    found = highest(palida, motion, 2000)
    assert_no_less_than_found(checks, found)
    for check, moment in zip(checks, found, strict=True):
        assert not (check.certified and moment.excess > TOLERANCE)


@pytest.mark.parametrize("count", [2, 7])
def test_a_proof_in_parts_has_the_digits_of_one_that_is_not_divided(palida, count):
    rng = np.random.default_rng(5)
    motion = EnclosedSeries(near_limits(palida, drawn(palida, rng), 0.0))
    enclosed, numbers = EnclosedLimits(palida), []

    def bound(moving, parts):
        numbers.append(len(parts))
        return [bound_cells(enclosed, moving, part) for part in parts]

    with share_cells(Sharing(palida, lambda: count, bound)):
        divided = certify(palida, motion)

    assert repr(divided) == repr(certify(palida, motion))
    assert max(numbers) == count


@pytest.mark.slow
@pytest.mark.parametrize("name", ["palida", THREADED])
def test_no_limit_is_certified_that_is_broken_between_samples(name):
    excess = 2.5e-6
    limits = LimitModel.of(robot(name))
    motion = near_limits(limits, drawn(limits, np.random.default_rng(7)), SPARE)
    limits = with_jerk(limits, motion, SPARE)
    planted = LimitModel(
        limits.robot,
        tuple(
            lowered(limit, moment, excess)
            for limit, moment in zip(limits.limits, highest(limits, motion, POINTS), strict=True)
        ),
    )

    checks = certify(planted, EnclosedSeries(motion))

    assert min(moment.excess for moment in highest(planted, motion, POINTS)) > 2e-6
    assert not any(check.certified for check in checks)


@pytest.mark.parametrize("gap", [2e-6, 2e-9, 1e-12])
def test_no_spike_of_dry_friction_is_overlooked(gap):
    limits = LimitModel.of(robot(STICKY))
    definition = limit_definitions()["actuator_force"]
    labels = row_labels(definition)
    tried = 0
    for seed in range(18):
        rng = np.random.default_rng(seed)
        struts = rng.choice(6, 2, replace=False)
        rates = tuple(("alpha_rate", int(strut)) for strut in struts)
        motion, time = spiked(limits, rng, gap, rates)
        boundless = LimitModel(limits.robot, (Limit.boundless(definition, labels),))
        around = time + gap * np.array([-20.0, 0.25, 0.5, 0.75, 20.0])
        inside = boundless.values(states(boundless, motion, around))
        outside = boundless.values(states(boundless, motion, motion.sample_times(4001)))
        for strut in range(6):
            spike = float(np.max(inside[1:4, strut]))
            level = float(max(np.max(outside[:, strut]), inside[0, strut], inside[4, strut]))
            if spike <= level + 1e-3 * abs(level):
                continue
            tried += 1
            upper = np.where(np.arange(6) == strut, (spike + level) / 2, np.inf)
            planted = Limit(definition, np.full(6, -np.inf), upper, labels, "test")
            (check,) = certify(LimitModel(limits.robot, (planted,)), EnclosedSeries(motion))
            assert not check.certified
            assert check.proved >= (spike - upper[strut]) / abs(upper[strut]) - 1e-9
    assert tried >= 3


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
    model = LimitModel(palida.robot, limits)

    with pytest.raises(NoEnclosureError):
        EnclosedLimits(model)
    motion = EnclosedSeries(drawn(palida, np.random.default_rng(1)))
    found = {check.key: check for check in certify(model, motion)}
    assert not found[known.key].certified
