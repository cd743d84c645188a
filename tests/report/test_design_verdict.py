"""Verdict on a design's limits: proved at every instant, or not proved."""

import pandas as pd
import pytest

from expdesign.stages.registry import reported_stages
from results.views.design import design_view
from results.views.folder import RunFolder


@pytest.fixture
def said(folder):
    """Return a maker of the verdict's sentence, of what is proved of some rows of the limits."""

    def made(proved=None, rows=slice(0)):
        place = folder / "tables" / "limits.csv"
        table = pd.read_csv(place)
        table.loc[table.index[rows], "proved"] = proved
        table.to_csv(place, index=False)
        keys = list(table["limit"])
        return design_view(RunFolder.open(folder, reported_stages())).verdict.sentence, keys

    return made


def test_all_is_proved(said):
    sentence, _ = said()
    assert "proved for every instant" in sentence
    assert "not proved" not in sentence


def test_what_is_not_proved_is_named(said):
    sentence, keys = said(2e-6, slice(1, 2))
    assert "not proved" in sentence
    assert keys[1] in sentence.split("not proved")[1].split(".")[0]
    assert keys[0] not in sentence.split("not proved")[1].split(".")[0]
