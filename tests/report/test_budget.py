"""What a report says of tolerances, and what two estimates of one machine have in common."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.identification import estimate_parameters, estimation_result
from results.comparison.estimates import ComparedEstimate
from results.views.blocks import budget_blocks, share_columns
from results.views.view import ReportTable
from tests.estimation.cases import measured, run, trajectory

MOTION = trajectory(100, 0.01)
TOLERANCES = {"force_constant": {"common": "5 %"}, "strut_length": "1 mm"}


def _record(seed, tolerances=TOLERANCES, **section):
    data = measured(MOTION, seed, step=0.01, force_scale=0.2, length_scale=0.2)
    given = {"harmonics": 2, "estimators": ["gm", "ml"], "systematic": "budget", **section}
    sections = {} if tolerances is None else {"tolerances": tolerances}
    return estimation_result(estimate_parameters(run(given, **sections), data, MOTION))


@pytest.fixture(scope="module")
def records():
    return _record(1), _record(2)


def test_the_budget_tells_what_each_tolerance_costs(records):
    _, table = budget_blocks(records[0])
    assert [column.title for column in table.columns] == [
        "parameter",
        "noise",
        "strut_length",
        "force_constant.common",
    ]
    for row in table.rows:
        assert sum(row[1:]) == pytest.approx(100)
    assert len(share_columns(records[0])) == 2


def test_without_tolerances_the_report_says_what_intervals_hold_for():
    record = _record(1, None, estimators=["gm"])
    (block,) = budget_blocks(record)
    assert not isinstance(block, ReportTable)
    assert not share_columns(record)
    assert not record.budget


def test_estimated_tolerances_are_listed():
    blocks = budget_blocks(_record(1, systematic="estimated"))
    listed = blocks[-1]
    assert len(listed.rows) == 7


def test_what_two_estimates_share_is_no_difference(records):
    one, other = (ComparedEstimate(str(n), None, r) for n, r in enumerate(records))
    names = records[0].parameters
    found = np.diag(one.difference_covariance(other, names))
    renamed = replace(other, result=replace(other.result, robot="palida-identified"))
    np.testing.assert_array_equal(np.diag(one.difference_covariance(renamed, names)), found)
    random, total = (
        sum(np.diag(getattr(r.best_estimator, key)) for r in records)
        for key in ("covariance_forces", "covariance")
    )
    kinematic = sum(np.diag(r.best_estimator.covariance_kinematics) for r in records)
    random = random + kinematic
    assert np.all(found >= random * (1 - 1e-9))
    # The same motion: tolerances do nearly the same to both.
    place = names.index("p10")
    assert total[place] > 5 * random[place]
    assert found[place] < 1.5 * random[place]
