"""What limits cost, in the report of a run: whose numbers they are, and when they are not told."""

import json
import re
from dataclasses import replace

import pytest

from expdesign.experiment import DesignRecord
from expdesign.experiment.sensitivity import FREQUENCY, LimitSensitivity
from expdesign.stages.report import reported_stages
from results.report.folder import RunFolder
from results.report.limit_gains import EXPLAINED, costliest, design_sensitivity, gains_table
from results.report.stages import design
from results.report.stages.design import design_report


def blocks(folder):
    return design_report(RunFolder.open(folder, reported_stages())).blocks


def gains(folder):
    return [b for b in blocks(folder) if b.kind == "table" and b.key == "limit_gains"]


def change(path, edit):
    document = json.loads(path.read_text(encoding="utf-8"))
    edit(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def test_the_design_is_recognised(whole):
    record = DesignRecord.read(whole)
    found = design_sensitivity(record)
    assert set(found.gains) == {limit.key for limit in record.robot.limits} | {FREQUENCY}
    assert all(gain >= 0 for gain in found.gains.values())
    assert 0 < found.unexplained <= 1


def test_gains_are_shown_near_an_optimum_only(whole, monkeypatch):
    record = DesignRecord.read(whole)
    found = design_sensitivity(record)
    monkeypatch.setattr(
        design, "design_sensitivity", lambda _: replace(found, unexplained=EXPLAINED)
    )
    (table,) = gains(whole)
    assert [row[1] for row in table.rows[:-1]] == [100 * gain for gain in found.gains.values()]
    assert table.rows[-1] == ("unexplained by the limits", 100 * EXPLAINED)
    monkeypatch.setattr(design, "design_sensitivity", lambda _: replace(found, unexplained=0.2))
    assert gains(whole) == []
    told = [b.text for b in blocks(whole) if b.kind == "text"]
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
    assert design_sensitivity(DesignRecord.read(folder)) is None
    assert gains(folder) == []


@pytest.mark.parametrize("other", [{"criterion": "a"}, {"log_det_information": None}])
def test_a_design_by_another_criterion_or_of_none_has_no_costs(folder, other):
    change(folder / "design.json", lambda document: document.update(other))
    assert design_sensitivity(DesignRecord.read(folder)) is None


def test_the_costliest_limit():
    found = LimitSensitivity({"tilt": 0.02, FREQUENCY: 0.05}, 0.01)
    assert costliest(found) == FREQUENCY
    assert costliest(replace(found, unexplained=0.2)) is None
    assert costliest(LimitSensitivity({"tilt": 0.0}, 0.01)) is None
    rows = gains_table({"one": found}, "the design itself").rows
    assert rows[:2] == (("tilt of the platform", 2.0), ("base frequency", 5.0))
