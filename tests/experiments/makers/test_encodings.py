"""Tables, programs and saves whose text is not UTF-8: read, and said; UTF-16 is named."""

import warnings

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import read_run
from zerobeam.model.parsing.reading import NotUtf8, read_other_text, read_text

HEADER = """\
robot: irb1600
tool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
"""
TABLE = "Größe;j1;j2;j3;j4;j5;j6\nç;10.5;-20;30;5;40;0\nñ;-15.5;-25;35;0;35;20\n"
RAPID = """\
MODULE Messung
  ! Prüfpunkt, €
  CONST jointtarget p1:=[[10.5,-20,30,5,40,0.5],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget p2:=[[-15.5,-25,35,0.5,35,20],[9E9,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""
WAYS = {"cp1252": "Windows-1252", "latin-1": "Windows-1252"}


def imported(tmp_path, kind, content, *options):
    (tmp_path / "header.yaml").write_text(HEADER, encoding="utf-8")
    (tmp_path / "in.txt").write_bytes(content)
    files = [*options, tmp_path / "in.txt", "--header", tmp_path / "header.yaml", "--target", "psd"]
    return zerobeam("import", kind, *files, "-o", tmp_path / "run.jsonl")


CSV = ("--units", "deg", "--header-row", "--columns", "j1,j2,j3,j4,j5,j6")


@pytest.mark.parametrize("encoding", WAYS)
@pytest.mark.parametrize(("kind", "text", "options"), [("csv", TABLE, CSV), ("rapid", RAPID, ())])
def test_national_letters_are_read_and_said(kind, text, options, encoding, tmp_path):
    text = text if encoding == "cp1252" else text.replace("€", "x")
    line = 1 if kind == "csv" else 2
    with warnings.catch_warnings(action="always", category=NotUtf8):
        answer = imported(tmp_path, kind, text.encode(encoding), *options)
    assert answer.status == 0, answer.err
    assert f"note: in.txt is not UTF-8 (line {line}). It is read as {WAYS[encoding]}" in answer.err
    joints = [shot.joints_deg for shot in read_run(tmp_path / "run.jsonl").shots]
    np.testing.assert_allclose([row[:3] for row in joints], [[10.5, -20, 30], [-15.5, -25, 35]])


def test_control_utf8_is_not_said(tmp_path):
    answer = imported(tmp_path, "csv", TABLE.encode("utf-8"), *CSV)
    assert answer.status == 0
    assert "UTF-8" not in answer.err


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("kind", ["csv", "rapid"])
def test_utf16_is_named(kind, encoding, tmp_path):
    text, options = (TABLE.replace("ö", "o").replace("ß", "s"), CSV) if kind == "csv" else (RAPID, ())
    answer = imported(tmp_path, kind, text.encode(encoding), *options)
    assert answer.status == 2
    assert "the text is UTF-16" in answer.err
    assert "save the file as UTF-8" in answer.err


def test_the_letters_themselves(tmp_path):
    path = tmp_path / "a.txt"
    for content, text in ((b"\xe4 \x80", "ä €"), (b"\xe4 \x81", "ä \x81")):
        path.write_bytes(content)
        with pytest.warns(NotUtf8):
            assert read_other_text(path) == text
    with pytest.raises(BadInput, match="not UTF-8"):
        read_text(path)  # a file of ours is UTF-8
    path.write_bytes(b"\xe4\0\1\2")
    with pytest.raises(BadInput, match="binary"):
        read_other_text(path)
