"""The example from its command line to the report."""

import json

import pandas as pd
import pytest

from examples.paper.run import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory, cheaper):
    """Return the folder of the quick studies."""
    out = tmp_path_factory.mktemp("paper")
    with cheaper():
        main(["--quick", "--workers", "1", "--out", str(out)])
    return out


def table(folder, name):
    return pd.read_csv(folder / "tables" / f"{name}.csv", keep_default_na=False)


@pytest.mark.slow
def test_the_report_has_all_claims_and_figures(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "they are simulated" in page
    claims = table(folder, "claims")
    assert claims["study"].nunique() == 3
    assert (claims["verdict"] != "").sum() > 20
    assert page.count("<svg") == len(list((folder / "figures").glob("*.svg"))) == 8


@pytest.mark.slow
def test_the_designs_show_the_pattern_of_table_2(folder):
    claims = table(folder, "claims")
    (first, *_) = claims[claims["claim"].str.contains("smaller determinant")].itertuples()
    assert first.verdict == "holds"
    determinants = table(folder, "determinants")
    assert (determinants[determinants["kinematics"] == "exact"]["difference"] > 0).all()
    one, two = table(folder, "designs").itertuples()
    for row in (one, two):
        assert json.loads((folder / row.folder / "design.json").read_text())["criterion"]
        assert row.keeps_limits
    assert two.condition_si < 0.1 * one.condition_si
    assert two.log_det_information < one.log_det_information


@pytest.mark.slow
def test_the_hausman_test_shows_where_the_information_is_disturbed(folder):
    found = table(folder, "hausman").groupby("case")["disturbed"].agg(set).to_dict()
    assert found == {"undisturbed": {False}, "pointwise": {True}, "tracking": {True}}


@pytest.mark.slow
def test_the_validation_names_the_struts(folder):
    for row in table(folder, "variances").itertuples():
        wanted = row.situation != "without" and row.actuator in (3, 4)
        if row.situation != "known":
            assert (row.fails == row.runs) == wanted, row
    (power,) = table(folder, "power").itertuples()
    assert (power.seen, power.runs) == (3, 3)
