import os
import shlex
import socket
from pathlib import Path

import pytest
from exact_runs import demo_runs
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from zerobeam.model.files.run import read_run
from zerobeam.model.parsing import reading
from zerobeam.model.parsing.reading import (
    LARGEST_YAML,
    _Bounded,
    parse_json,
    read_bytes,
    read_text,
    read_yaml,
)


def yaml(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("no", "no"),
        ("2024-05-01", "2024-05-01"),
        ("0o17", 15),
        ("0x1F", 31),
        ("1_000", "1_000"),
        ("~", None),
        ("+1.5e3", 1500.0),
        ('"12"', "12"),
        ("[true, False, null, .5]", [True, False, None, 0.5]),
        ("12:30:00", "12:30:00"),
    ],
)
def test_yaml_follows_the_core_schema_of_1_2(tmp_path, word, value):
    assert read_yaml(yaml(tmp_path, f"a: {word}\n")).data == {"a": value}


def test_places_have_the_lines_of_their_keys(tmp_path):
    document = read_yaml(yaml(tmp_path, "# comment\na: 1\nb:\n  c:\n    - 1\n    -\n      d: 2\n"))
    assert [
        document.line(position)
        for position in [("a",), ("b",), ("b", "c"), ("b", "c", 0), ("b", "c", 1, "d")]
    ] == [2, 3, 4, 5, 7]
    assert document.line(("b", "c", 1, "missing")) == 7
    assert document.line(("b", "c", 1, "missing")) == document.line(("b", "c", 1))


@pytest.mark.parametrize("word", [".nan", ".inf", "-.INF", "1e999"])
def test_numbers_that_are_not_finite_are_refused(tmp_path, refused, word):
    error = refused(read_yaml, yaml(tmp_path, f"a: 1\nb: {word}\n"))
    assert error.line == 2
    assert error.found == word


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity", "1e999", "1" + "0" * 400])
def test_json_numbers_that_are_not_finite_are_refused(refused, word):
    error = refused(parse_json, f'{{"a": {word}}}', file=Path("f"), line=7)
    assert "finite" in error.what
    assert error.line == 7


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "duplicate"),
        ("a: 1\nb: [1, 2\n", 3, "not valid YAML"),
        ("a: 1\nb: !python/object:os.system x\n", 2, "tag"),
        ("- 1\n- 2\n", 1, "keys and values"),
        ("just text", 1, "keys and values"),
        ("1: a\n", 1, "key must be text"),
        ("[1, 2]: a\n", 1, "key must be text"),
        ("a: 1\n---\nb: 2\n", 2, "not valid YAML"),
        ("a:\n\tb: 1\n", 2, "not valid YAML"),
        ("# a comment only\n", None, "keys and values"),
        (b"a: 1\nb: \xff\n", 2, "not UTF-8"),
        (b"a: 1\0\n", None, "binary"),
        ("a: &x [*x]\n", 1, "not valid YAML|nested"),
        ("a: " + "[" * 500, 1, "nested|not valid YAML"),
    ],
)
def test_what_is_no_good_yaml_is_refused_with_its_line(tmp_path, text, line, what, refused):
    error = refused(read_yaml, yaml(tmp_path, text))
    assert any(part in error.what for part in what.split("|")), error
    if "[" * 100 not in str(text):
        assert error.line == line
    assert str(tmp_path / "file.yaml") in str(error)


def test_aliases_of_aliases_do_not_fill_the_memory(tmp_path, refused):
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    assert "200000 values" in refused(read_yaml, yaml(tmp_path, "\n".join(rows))).what


def test_missing_file_folder_and_empty_file(tmp_path, refused):
    yaml(tmp_path, "a: 1")
    assert "did you mean 'file.yaml'?" in str(refused(read_text, tmp_path / "fiel.yaml"))
    assert refused(read_text, tmp_path / "file.ls").remedy is None  # another kind of file
    assert "'file.yaml'" in str(refused(read_text, tmp_path / "file.yml"))
    assert "'file.yaml'" in str(refused(read_text, tmp_path / "file"))
    assert refused(read_text, tmp_path / "long.yaml").remedy is None  # the ending alone is alike
    assert "does not exist either" in str(refused(read_text, tmp_path / "no" / "file.yaml"))
    assert "folder" in refused(read_text, tmp_path).what
    assert "empty" in refused(read_text, yaml(tmp_path, " \n\n")).what
    assert "cannot be read" in refused(read_text, Path("a\0b")).what


def test_a_run_that_is_given_for_a_yaml_file_is_called_one(tmp_path, refused):
    run = demo_runs()[0].path
    error = refused(read_yaml, run)
    assert "this is a run" in error.what
    assert error.remedy == f"analyse it: zerobeam analyse {shlex.quote(run.as_posix())}"


def test_a_table_that_is_given_for_a_run_is_to_be_imported(tmp_path, refused):
    table = tmp_path / "my shots.csv"
    table.write_text("1,2,3\n")
    assert f"zerobeam import csv '{table}'" in refused(read_run, table).remedy


def test_only_regular_files_are_opened(tmp_path, refused):
    pipe, link, plug = tmp_path / "pipe", tmp_path / "link", tmp_path / "plug"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(plug))
        result = [refused(read_text, path).found for path in (pipe, link, plug, Path("/dev/null"))]
    assert result == ["a pipe", "a device", "a socket", "a device"]


def test_a_file_is_read_up_to_the_size_for_its_kind(tmp_path, refused):
    path = yaml(tmp_path, "a: 1\n")
    os.truncate(path, LARGEST_YAML + 1)
    error = refused(read_yaml, path)
    assert (error.what, error.found) == ("the file is too large", "more than 4 MB")
    assert len(read_bytes(path)) == LARGEST_YAML + 1
    os.truncate(path, 10**12)  # a hole: it takes no room on the disk
    assert refused(read_bytes, path, 10**6).allowed == "at most 1 MB for a file of this kind"


def test_many_values_end_where_too_many_are_read(tmp_path, refused, monkeypatch):
    monkeypatch.setattr(reading, "MOST_VALUES", 100)
    assert read_yaml(yaml(tmp_path, f"a: [{'1,' * 50}]\n")).data == {"a": [1] * 50}
    monkeypatch.setattr(_Bounded, "_left", 200)
    error = refused(read_yaml, yaml(tmp_path, f"a:\n  [{'1,' * 300}]\n"))
    assert (error.what, error.line) == ("the file holds more than 100 values", 2)


def test_a_byte_order_mark_is_no_content(tmp_path):
    assert read_yaml(yaml(tmp_path, b"\xef\xbb\xbfa: 1\n")).data == {"a": 1}


def test_json_keys_stand_once(refused):
    assert "duplicate" in refused(parse_json, '{"a": 1, "a": 1}', file=Path("f"), line=1).what
    assert "nested" in refused(parse_json, "[" * 100_000, file=Path("f"), line=1).what


words = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Zl", "Zp"]), max_size=8)
scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**9), 10**9),
    st.floats(allow_nan=False, allow_infinity=False),
    words,
)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.dictionaries(words, scalars | st.lists(scalars, max_size=4), min_size=1, max_size=4))
def test_what_another_writer_wrote_is_read_as_it_was(tmp_path, content):
    path = tmp_path / "round.yaml"
    writer = YAML()
    with path.open("w", encoding="utf-8") as file:
        writer.dump(content, file)
    assert read_yaml(path).data == content
