"""Everything that can be limited, enclosed, against formulas that are not the package's."""

import mpmath
import numpy as np
import pytest

from expdesign.enclosure.limit_rows import EnclosedLimits
from expdesign.enclosure.paths import EnclosedSeries
from tests.enclosure.by_virtual_work import Machine
from tests.enclosure.machines import ALL, everything
from tests.enclosure.motions import drawn

INSTANTS = 1
ROUNDED = 1e-12
"""Share of a quantity's size by which the cardan frames, rounded, are off what they stand for."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_every_row_holds_what_the_motion_does_and_is_close_to_it(name):
    limits = everything(name)
    rng = np.random.default_rng(len(name))
    trajectory = drawn(limits, rng)
    machine, period = Machine(limits.robot, trajectory), trajectory.period
    times = rng.uniform(0, period, INSTANTS)
    # Cells as a certificate begins with, and such as it ends with; the instant is anywhere in them.
    widths = np.array([period / 512, 1e-9 * period])
    starts = times - rng.uniform(0, 1, (2, INSTANTS)) * widths[:, None]
    edges = np.stack([starts, starts + widths[:, None]], axis=2).reshape(-1, 2)

    with np.errstate(all="ignore"):
        rows, _ = EnclosedLimits(limits)(
            EnclosedSeries(trajectory).models(edges), range(len(limits.limits))
        )
        bounds = {
            limits.limits[k].key: [np.reshape(row.bounds(), (2, 2, INSTANTS)) for row in own]
            for k, own in rows.items()
        }
        sure = {
            limits.limits[k].key: [
                np.broadcast_to(row.jump, len(edges))[INSTANTS:] == 0 for row in own
            ]
            for k, own in rows.items()
        }

    for n, time in enumerate(times):
        expected = machine.limited(mpmath.mpf(float(time)))
        assert set(expected) == set(bounds)
        for key, values in expected.items():
            assert len(values) == len(bounds[key])
            size = max(abs(float(value)) for value in values) + 1e-3
            for row, exact in enumerate(values):
                low, high = bounds[key][row][:, :, n]
                value = float(exact)
                assert np.all(value <= high + ROUNDED * size), (key, row)
                assert value >= high[1] - 1e-4 * size or not sure[key][row][n], (key, row)
                if key != "jacobian_condition":
                    assert np.all(value >= low - ROUNDED * size), (key, row)
                    assert value <= low[1] + 1e-4 * size or not sure[key][row][n], (key, row)
