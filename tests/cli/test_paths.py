"""What stands where a path is wanted: nothing at all, or more than a system takes."""

import pytest

LONG = "x" * 300
DEEP = "y/" * 3000


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """An empty text must not become the current folder: it is an empty one, and stays so."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "arguments",
    [
        ("design", "palida", "--out", ""),
        ("design", "palida", "--out="),
        ("run", ""),
        ("check", "palida", "--machine", "--out", ""),
        ("simulate", "palida", "--design", ""),
        ("estimate", "palida", "--data", ""),
        ("report", ""),
        ("export", "", "--format", "csv"),
        ("export", "somewhere", "--format", "csv", "--out", ""),
        ("compare", "", "", "--out", "there"),
        ("init", "", "--json"),
        ("init", "lab", "--from="),
    ],
)
def test_an_empty_text_is_bad_input(arguments, expdesign, tmp_path):
    status, output, error = expdesign(*arguments)
    assert status == 2
    named = [text.rstrip("=") for text in arguments if text.startswith("--o")]
    assert "empty" in output + error
    assert not named or "there" in arguments or named[0] in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [LONG, DEEP])
@pytest.mark.parametrize(
    "arguments",
    [
        ("design", "palida", "--out", "{}"),
        ("run", "palida", "--out", "{}"),
        ("run", "{}"),
        ("check", "{}.yaml"),
        ("check", "palida", "--machine", "--out", "{}"),
        ("simulate", "palida", "--design", "{}"),
        ("simulate", "palida", "--table", "{}"),
        ("estimate", "palida", "--data", "{}.csv"),
        ("validate", "palida", "--estimate", "{}"),
        ("report", "{}"),
        ("export", "{}", "--format", "csv"),
        ("compare", "{}", "{}", "--out", "there"),
        ("compare", "here", "here", "--out", "{}"),
        ("init", "lab", "--from", "{}.xml"),
        ("init", "lab", "--out", "{}", "--json"),
        ("init", "{}", "--json"),
    ],
)
def test_a_name_that_no_system_takes_is_bad_input(arguments, name, expdesign, tmp_path):
    status, output, error = expdesign(*(text.format(name) for text in arguments))
    assert status == 2
    assert "error" in error or "problems" in output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("export", "somewhere", "--format", "csv", "--format=ros2"), "--format"),
        (("design", "palida", "--out", "a", "--out", "b"), "--out"),
        (("simulate", "palida", "--design", "a", "--design", "a"), "--design"),
    ],
)
def test_an_option_given_twice_is_bad_input(arguments, option, expdesign, tmp_path):
    """Nobody would see which of the two counted."""
    status, _, error = expdesign(*arguments)
    assert status == 2
    assert option in error
    assert not list(tmp_path.iterdir())


def test_options_of_several_values_are_given_several_times(expdesign):
    """The same holds for what names several recordings: the first that is missing is told."""
    status, _, error = expdesign("estimate", "palida", "--data", "one.csv", "--data", "two.csv")
    assert status == 2
    assert "one.csv" in error
    assert "--data" not in error
