"""`zerobeam positions`: what an owner types, sees and gets."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import zerobeam
from made_backups import DIALECTS, ENTERED, written

TP = DIALECTS["TP"]
ZEROS = ",".join(f"J{i}={value}" for i, value in enumerate(ENTERED, start=1))


def test_keep_writes_all_and_says_where_to_go_first(tmp_path: Path) -> None:
    backup = TP.made(2)
    folder, new = written(backup, tmp_path / "backup"), tmp_path / "new"
    answer = zerobeam("positions", "keep", folder, "--robot", TP.robot, "--entered", ZEROS, "-o", new)
    assert answer.status == 0
    assert answer.out.startswith("Converted. Approach P")
    assert "Convert the whole backup, or parts will disagree by up to" in answer.out.replace("\n", " ")
    audit = json.loads((new / "audit.json").read_text())
    assert audit["schema"] == "zerobeam/positions/1"
    assert {each.name for each in new.iterdir()} >= {
        "positions.html",
        "positions.pdf",
        "audit.json",
        "WORK.LS",
    }
    for row in audit["positions"]:
        assert row["name"] in (new / "positions.html").read_text()
    again = zerobeam("positions", "keep", new, "--robot", TP.robot, "--entered", ZEROS, "-o", tmp_path / "2")
    assert again.status == 2
    assert "converted before" in again.err
    onto = zerobeam("positions", "keep", folder, "--robot", TP.robot, "--entered", ZEROS, "-o", new)
    assert onto.status == 2
    back = zerobeam("positions", "restore", new, "-o", tmp_path / "old")
    assert back.status == 0
    for one in audit["files"]:
        assert (tmp_path / "old" / one["file"]).read_bytes() == backup.texts[one["file"]].encode("latin-1")


def test_what_is_refused_is_named_by_line_and_nothing_is_written(tmp_path: Path) -> None:
    backup = TP.made(2)
    backup.texts["WORK.LS"] = backup.texts["WORK.LS"].replace("/POS", "  99:  UTOOL[1]=PR[3]    ;\n/POS", 1)
    folder, new = written(backup, tmp_path / "backup"), tmp_path / "new"
    typed = ("positions", "keep", folder, "--robot", TP.robot, "--entered", ZEROS, "-o", new)
    answer = zerobeam(*typed)
    assert answer.status == 1
    assert "WORK.LS:11" in answer.out
    assert not new.exists()
    assert zerobeam(*typed, "--json").json["refused"][0]["line"] == 11


@pytest.mark.parametrize("language", DIALECTS)
def test_show_converts_nothing(language: str, tmp_path: Path) -> None:
    backup = DIALECTS[language].made(3)
    answer = zerobeam("positions", "show", written(backup, tmp_path), "--json")
    assert answer.status == 0
    assert [one["name"] for one in answer.json["positions"]]
    assert all(one["after"] is None for one in answer.json["positions"])
    assert len(answer.json["positions"]) == len(backup.positions)


def test_what_is_no_backup_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    for path in (tmp_path, tmp_path / "notes.txt", tmp_path / "none"):
        assert zerobeam("positions", "show", path).status == 2
