"""A judged limit as a row of a table, and what follows from it."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.export.certification import PathCertificate
from expdesign.export.read_back import limits_in_words
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck
from expdesign.runfolder import RowTable

LIMITS = RowTable("tables/limits.csv", "`expdesign design`", LimitCheck)
SPEED = LimitCheck(
    "strut_speed", "strut speed", "strut 4", "m/s", -1.5, -2.0, -0.125, 1.25, "robot.yaml"
)
BROKEN = LimitCheck("tilt", "tilt", "", "rad", np.nan, 0.3, np.inf, 0.5, "robot.yaml")


def test_a_table_of_checks_is_read_as_it_was_written(tmp_path):
    LIMITS.write(tmp_path, [SPEED, BROKEN])

    kept, broken = LIMITS.read(tmp_path)

    assert kept == SPEED
    assert np.isnan(broken.value)
    assert not broken.kept


def test_a_limit_is_kept_within_the_tolerance_of_its_range():
    at = [
        LimitCheck("tilt", "tilt", "", "rad", 0.3, 0.3, excess, 0.0, "")
        for excess in (-1.0, 0.0, TOLERANCE, 1.01 * TOLERANCE, np.nan)
    ]

    assert [check.kept for check in at] == [True, True, True, False, False]


def test_what_is_used_counts_from_the_middle_of_the_range():
    assert SPEED.used == pytest.approx(0.75)
    assert (SPEED.strut, BROKEN.strut) == (4, None)


def test_a_table_that_exceeds_a_limit_within_its_tolerance_says_so():
    near = LimitCheck(
        "strut_acceleration",
        "strut acceleration",
        "strut 4",
        "m/s^2",
        30.0084,
        30.0,
        1.4e-4,
        0.7,
        "",
    )

    words = limits_in_words(PathCertificate((SPEED, near)))

    for part in ("strut acceleration of strut 4", "30.0084", "30 m/s^2", "0.014 %", "0.1 %"):
        assert part in words
    assert "kept" not in words
    reserved = tuple(replace(SPEED, reserve=share) for share in (0.05, 0.0, 0.1))
    assert "5 % to 10 %" in limits_in_words(PathCertificate(reserved))


def test_a_limit_that_is_kept_and_not_proved_is_named():
    proved = replace(SPEED, proved=-0.1)
    open_one = replace(SPEED, title="tilt", proved=3e-5)

    kept, left = (
        limits_in_words(PathCertificate(limits)) for limits in ((proved,), (proved, open_one))
    )

    assert "every limit kept" in kept
    assert "not proved" not in kept
    for part in ("every limit kept", "not proved", "tilt", "0.003 %"):
        assert part in left
    assert "strut speed" not in left
