import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from expdesign.configuration import load_run
from expdesign.configuration.document import LARGEST_FILE, read_yaml
from expdesign.configuration.errors import InputError


@pytest.fixture
def read(tmp_path):
    """Read text or bytes as a YAML file."""

    def reader(content):
        path = tmp_path / "some.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_yaml(path)

    return reader


@pytest.fixture
def refused(read):
    """Return the problems of reading a text."""

    def problems(content):
        with pytest.raises(InputError) as caught:
            read(content)
        return caught.value.problems

    return problems


def test_plain_types_and_lines(read):
    document = read(
        "# comment\n"
        "a: 1\n"
        "b: [1.5, 1e-3, 0x10, yes, true, ~, 'x', 2020-01-01]\n"
        "c:\n"
        "  d: -22.95 in\n"
        "  e:\n"
        "    - 1\n"
        "    - 2\n"
    )
    assert document.data == {
        "a": 1,
        "b": [1.5, 1e-3, 16, "yes", True, None, "x", "2020-01-01"],
        "c": {"d": "-22.95 in", "e": [1, 2]},
    }
    assert document.line(("a",)) == 2
    assert document.line(("c", "d")) == 5
    assert document.line(("c", "e", 1)) == 8
    assert document.line(("c", "unknown")) == 4
    assert document.line(("unknown",)) is None


def test_anchors_and_merge_keys(read):
    document = read("a: &x {p: 1, q: 2}\nb: *x\nc: {<<: *x, q: 3}\nd: {<<: [*x, {p: 5, r: 6}]}\n")
    assert document.data["b"] == {"p": 1, "q": 2}
    assert document.data["c"] == {"p": 1, "q": 3}
    assert document.data["d"] == {"p": 1, "q": 2, "r": 6}


def test_byte_order_mark_is_no_part_of_the_first_key(read):
    assert read(b"\xef\xbb\xbfa: 1\n").data == {"a": 1}


@pytest.mark.parametrize(
    ("content", "says", "line"),
    [
        ("", "empty", None),
        ("# only a comment\n", "empty", None),
        ("a: 1\nb: 2\na: 3\n", "occurs twice; it is also in line 1", 3),
        ("a:\n  b: 1\n  b: 2\n", "occurs twice", 3),
        ("- 1\n- 2\n", "contains a list", 1),
        ("just text\n", "contains one value", 1),
        ("a: [1, 2\n", "not valid YAML", 2),
        ("a: 1\n\tb: 2\n", "line 2 is indented with a tab; YAML allows spaces only", 2),
        ("a:\n  b: 1\n\tc: 2\n", "line 3 is indented with a tab", 3),
        ("a:\n  \tb: 1\n", "line 2 is indented with a tab", 2),
        ("a: 1\nb:\t2\n", "line 2 contains a tab; YAML allows spaces only", 2),
        ("a: *unknown\n", "not valid YAML: found undefined alias", 1),
        ("a: 1\n---\nb: 2\n", "not valid YAML", 2),
        ("1: a\n", "a key is not a text", 1),
        ("a: 1\np: {p1: 5,0e-4}\n", "write decimals with a point", 2),
        ("? [a, b]\n: c\n", "a key is not a text", 1),
        ("a: !!python/object/apply:os.system ['true']\n", "tag !!python/object/apply", 1),
        ("a: !custom x\n", "tag !custom is not allowed", 1),
        ("!!python/object:x.Y {}\n", "is not allowed", 1),
        ("a: !!binary aGVsbG8=\n", "tag !!binary is not allowed", 1),
        ("a: !!set {x}\n", "tag !!set is not allowed", 1),
        ("a: !!int hello\n", "cannot be read", 1),
        ("a: " + "9" * 10_000 + "\n", "cannot be read", 1),
        ("<<: 5\n", "only mappings can be merged", 1),
        ("a: &x [*x]\n", "the anchor contains itself", 1),
        ("a: &x {b: *x}\n", "the anchor contains itself", 1),
        ("a: &x\n  <<: *x\n", "the anchor contains itself", 1),
        ("[" * 1000, "nested too deeply", None),
        ("{a: " * 100 + "1" + "}" * 100, "nested too deeply", 1),
        (b"a: \xff\n", "byte 0xff is not UTF-8", 1),
        (b"a: 1\nb: \xe4\n", "not UTF-8", 2),
        ("a: 1".encode("utf-16"), "not UTF-8|binary", None),
        (b"\x7fELF\x00\x01\x02", "binary", None),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "binary", None),
        ("a: \x07\n", "not valid YAML", None),
        ("a: 1\n" + "#" * LARGEST_FILE, "too large", None),
    ],
)
def test_refused_with_one_clear_problem(refused, content, says, line):
    (problem,) = refused(content)
    assert any(part in problem.message for part in says.split("|")), problem.message
    if line is not None:
        assert problem.line == line
    assert problem.file is not None
    assert problem.message.isprintable()


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_yaml(tmp_path / "missing.yaml")
    with pytest.raises(InputError, match="folder"):
        read_yaml(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        read_yaml(tmp_path / ("x" * 5000))


def test_all_duplicates_and_tags_are_reported_at_once(refused):
    problems = refused("a: 1\na: 2\nb: !x 1\nc: {d: 1, d: 2}\n")
    assert [(p.key, p.line) for p in problems] == [("a", 2), ("b", 3), ("c.d", 4)]


def test_expansion_of_anchors_is_bounded(refused):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    # Without a bound this would not end.
    (problem,) = refused("\n".join(lines))
    assert "values in all" in problem.message


def test_merge_keys_do_not_escape_the_bound(refused):
    lines = ["a0: &a0 {k: [1, 1, 1, 1, 1, 1, 1, 1]}"]
    for i in range(1, 12):
        keys = ", ".join(f"k{j}: *a{i - 1}" for j in range(8))
        lines.append(f"a{i}: &a{i} {{{keys}}}")
    (problem,) = refused("\n".join(lines))
    assert "values in all" in problem.message


@given(content=st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_any_content_is_read_or_refused(tmp_path_factory, content):
    _read_or_refuse(tmp_path_factory, content)


@given(content=st.text(alphabet="ab1:-?[]{}&*!|>'\"%@`#,~<= \n\t\\.%", max_size=60))
def test_any_text_of_yaml_marks_is_read_or_refused(tmp_path_factory, content):
    _read_or_refuse(tmp_path_factory, content)


def _read_or_refuse(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    path.write_bytes(raw)
    try:
        document = read_yaml(path)
    except InputError:
        return
    assert isinstance(document.data, dict)


SECRET = "do-not-show-this"


@pytest.mark.parametrize(
    "content",
    [
        f"root:{SECRET}:0:0:root:/root:/bin/sh\ndaemon:x:1:1::/:/bin/sh\n",
        f"- {SECRET}: {SECRET}\n- {SECRET}: 1\n",
        f"!!python/{SECRET} [1]\n",
        f"*{SECRET}\n",
        f"[&{SECRET} a, &{SECRET} b, *{SECRET}x]\n",
        f"{SECRET}\n\t{SECRET}: '{SECRET}\n",
        f'"{SECRET}\n',
        f"%{SECRET}\n",
        f"2024-01-01 {SECRET} key = {SECRET}\n",
    ],
)
def test_what_stands_in_a_file_that_is_no_mapping_is_not_shown(content, refused):
    """Any file may be named as a robot: its words are not ours to tell."""
    for problem in refused(content):
        assert SECRET not in str(problem)


FOREIGN = {
    "keys": f"{SECRET}: 1\nkey_{SECRET}: {SECRET}\n",
    "a key twice": f"{SECRET}: 1\n{SECRET}: 2\n",
    "a tag": f"services: !{SECRET} {{}}\n",
    "a key that is no text": f"5: {SECRET}\n",
    "an anchor in itself": f"a: &{SECRET} {{{SECRET}: *{SECRET}}}\n",
    "too deep": f"{SECRET}: " + "[" * 60 + "]" * 60,
    "merged": f"<<: [{{{SECRET}: 1}}, &a {{k_{SECRET}: 2, <<: *a}}]\n",
    "keys inside": f"{SECRET}:\n  name: a\n  robot: palida\n  base_joints: []\n",
    "nothing": "{}\n",
}
"""Mappings of other programs."""


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN)
def test_a_mapping_of_another_program_is_no_run_and_no_robot(content, tmp_path, problems_of):
    foreign, run = tmp_path / "foreign.yaml", tmp_path / "run.yaml"
    foreign.write_text(content)
    run.write_text("name: a\nrobot: foreign.yaml\n")
    for asked, key in ((foreign, "trajectory"), (run, "base_joints")):
        (problem,) = problems_of(asked)
        assert (problem.file, problem.line, problem.key) == (foreign, None, "")
        assert key in problem.allowed
        assert SECRET not in str(problem)


@pytest.mark.parametrize("content", ["nam: a\nlimits: {}\n", "<<: {name: a}\nhoem: 1\n"])
def test_one_key_of_a_robot_makes_a_robot_file(content, tmp_path, problems_of):
    robot, run = tmp_path / "robot.yaml", tmp_path / "run.yaml"
    robot.write_text(content)
    run.write_text("name: a\nrobot: robot.yaml\n")
    nearest = {problem.nearest for problem in problems_of(run)}
    assert nearest & {"name", "home"}


def test_of_very_many_problems_the_first_are_told(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("name: many\nrobot: palida\n" + "".join(f"expert{n}: 1\n" for n in range(900)))
    with pytest.raises(InputError) as caught:
        load_run(file)
    *told, rest = caught.value.problems
    assert [problem.key for problem in told] == [f"expert{n}" for n in range(len(told))]
    assert 10 <= len(told) <= 30
    assert rest.more == 900 - len(told)
    assert str(rest.more) in str(rest)
    # Those of the robot come to it, and are counted with them.
    again = InputError([*told, rest, *told])
    assert again.problems[: len(told)] == tuple(told)
    assert again.problems[-1].more == 900


def test_a_key_is_told_short(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("name: a\nrobot: palida\ndesign: {" + "k" * 100_000 + ": 1}\n")
    with pytest.raises(InputError) as caught:
        load_run(file)
    assert len(str(caught.value)) < 1000


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    pipe = tmp_path / "run.yaml"
    os.mkfifo(pipe)
    with pytest.raises(InputError) as caught:
        read_yaml(pipe)
    assert caught.value.problems[0].file == pipe
