"""The command `init-data`: a section `data` that a run file takes as it is printed."""

import json

import pytest

from expdesign.configuration import load_run
from tests.data.recordings import recording


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.csv"
    names = {f"Q{j}": f"Kraft {j} [kN]" for j in range(1, 7)}
    recording().frame.rename(columns=names).to_csv(path, index=False, sep=";", decimal=",")
    return path


def test_the_printed_section_is_one_of_a_run_file(log, tmp_path, expdesign):
    run = tmp_path / "run.yaml"
    run.write_text("name: r\nrobot: palida\n")
    status, printed, _ = expdesign("init-data", log, "--run", run)
    assert status == 0
    assert "# 60 rows, 1000 Hz, 0.059 s" in printed
    run.write_text(f"name: r\nrobot: palida\n{printed}")
    section = load_run(run).run.data
    assert section.file == str(log)
    assert section.columns == {f"Q{j}": f"Kraft {j} [kN]" for j in range(1, 7)}
    out = tmp_path / "section.yaml"
    assert expdesign("init-data", log, "--run", run, "--out", out)[0] == 0
    assert out.read_text() == printed
    status, _, said = expdesign("init-data", log, "--out", out)
    assert (status, "the file exists" in said) == (2, True)


def test_questions_are_comments_and_entries_of_the_json(log, tmp_path, expdesign):
    log.write_text(log.read_text().replace("[kN]", "[PWM]"))
    _, printed, said = expdesign("init-data", log)
    assert "  # ? units: {Q: …}: 'PWM' is not known\n" in printed
    assert "`# ?` to answer" in said
    found = json.loads(expdesign("init-data", log, "--json")[1])
    assert found["data"]["delimiter"] == ";"
    assert any("'PWM' is not known" in text for text in found["questions"])
    status, _, said = expdesign("init-data", tmp_path / "none.csv")
    assert (status, "there is no such file" in said) == (2, True)
