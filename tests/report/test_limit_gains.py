"""What limits cost, in the report of a run: whose numbers they are, and when they are not told."""

import json
import re
from dataclasses import replace

import pandas as pd
import pytest

from expdesign.experiment import DesignResult
from expdesign.experiment.sensitivity import EXPLAINED, FREQUENCY, LimitSensitivity
from expdesign.stages.registry import reported_stages
from results.views import design
from results.views.design import (
    design_sensitivity,
    design_view,
    gains_table,
    reserve_in_words,
)
from results.views.folder import RunFolder


def blocks(folder):
    return design_view(RunFolder.open(folder, reported_stages())).blocks


def gains(folder):
    return [b for b in blocks(folder) if b.kind == "table" and b.key == "limit_gains"]


def change(path, edit):
    document = json.loads(path.read_text(encoding="utf-8"))
    edit(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def test_the_design_is_recognised(whole):
    record = DesignResult.read(whole)
    found = design_sensitivity(record)
    assert set(found.gains) == {limit.key for limit in record.robot.limits} | {FREQUENCY}
    assert all(gain >= 0 for gain in found.gains.values())
    assert 0 < found.unexplained <= 1


def test_gains_are_shown_near_an_optimum_only(whole, monkeypatch):
    record = DesignResult.read(whole)
    found = design_sensitivity(record)
    monkeypatch.setattr(
        design, "design_sensitivity", lambda _: replace(found, unexplained=EXPLAINED)
    )
    (table,) = gains(whole)
    assert [row[1] for row in table.rows[:-1]] == [100 * gain for gain in found.gains.values()]
    assert table.rows[-1] == ("unexplained by the limits", 100 * EXPLAINED)
    monkeypatch.setattr(design, "design_sensitivity", lambda _: replace(found, unexplained=0.2))
    assert gains(whole) == []
    told = [b.text for b in blocks(whole) if b.kind == "text" and "gradient" in b.text]
    assert len(told) == 1
    assert "20 % of the cost's gradient" in told[0]


@pytest.mark.parametrize(
    ("pattern", "other"),
    [
        (r"strut_speed: 2\.0", "strut_speed: 2.5"),
        (r"\n +tilt: 0\.349\d*", ""),
        (r"force_std: \[20\.32", "force_std: [25.0"),
        (r"harmonics: 2", "harmonics: 3"),
        (r"samples: 24", "samples: 30"),
    ],
)
def test_a_configuration_of_something_else_is_not_used(folder, pattern, other):
    run = folder / "run.yaml"
    text, count = re.subn(pattern, other, run.read_text(encoding="utf-8"), count=1)
    assert count == 1
    run.write_text(text, encoding="utf-8")
    assert design_sensitivity(DesignResult.read(folder)) is None
    assert gains(folder) == []


@pytest.mark.parametrize("other", [{"criterion": "a"}, {"log_det_information": None}])
def test_a_design_by_another_criterion_or_of_none_has_no_costs(folder, other):
    change(folder / "design.json", lambda document: document.update(other))
    assert design_sensitivity(DesignResult.read(folder)) is None


def test_what_a_reserve_costs_is_told_in_words():
    reserves = {"tilt": 0.05, "strut_speed": 0.1, "alpha": 0.0}
    found = LimitSensitivity({}, 0.01, {"tilt": 0.0, "strut_speed": 0.034}, 0.034)
    text = reserve_in_words(found, reserves, "d")
    for part in ("5 % to 10 %", "tilt of the platform", "3.4 %", "D-efficiency", "first order"):
        assert part in text
    assert "D-efficiency" not in reserve_in_words(found, reserves, "a")
    assert "tilt of the platform 0" not in text
    for unknown in (None, replace(found, unexplained=0.2)):
        text = reserve_in_words(unknown, reserves, "d")
        assert "5 % to 10 %" in text
        assert "3.4 %" not in text
    assert reserve_in_words(found, {"tilt": 0.0}, "d") == ""


def test_a_report_states_bounds_and_reserve_where_there_is_one(folder):
    def limits():
        (table,) = [b for b in blocks(folder) if b.kind == "table" and b.key == "limits"]
        return table

    before = limits()
    assert "stated" not in {column.title for column in before.columns}
    assert "limits.tilt" in before.caption  # holds the attitude as well
    run = folder / "run.yaml"
    text = run.read_text(encoding="utf-8")
    run.write_text(
        re.sub(
            r"( +)strut_speed: 2\.0", r"\1strut_speed: 2.5\n\1reserve: {strut_speed: 0.1}", text
        ),
        encoding="utf-8",
    )
    path = folder / "tables/limits.csv"
    frame = pd.read_csv(path, dtype=str, keep_default_na=False)
    frame.loc[frame["limit"] == "strut_speed", ["stated", "reserve"]] = "2.5", "0.1"
    frame.to_csv(path, index=False)
    after = limits()
    names = [column.title for column in after.columns]
    (row,) = [row for row in after.rows if row[0] == "strut speed"]
    assert row[names.index("stated")] == pytest.approx(2.5)
    assert row[names.index("reserve")] == pytest.approx(10)
    told = [b.text for b in blocks(folder) if b.kind == "text" and "reserve" in b.text]
    assert len(told) == 1
    assert "strut speed" in told[0]


def test_the_costliest_limit():
    found = LimitSensitivity({"tilt": 0.02, FREQUENCY: 0.05}, 0.01)
    assert found.costliest == FREQUENCY
    assert replace(found, unexplained=0.2).costliest is None
    assert LimitSensitivity({"tilt": 0.0}, 0.01).costliest is None
    rows = gains_table({"one": found}, "the design itself").rows
    assert rows[:2] == (("tilt of the platform", 2.0), ("base frequency", 5.0))
