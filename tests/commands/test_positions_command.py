"""`zerobeam positions`: what an owner types, sees and gets."""

import json
from pathlib import Path

import pytest
from command_line import zerobeam
from made_backups import DIALECTS, ENTERED, written

from zerobeam.words.controllers import POSITIONS

TP = DIALECTS["TP"]
ZEROS = ",".join(f"J{i}={value}" for i, value in enumerate(ENTERED, start=1))


def test_keep_writes_all_and_says_where_to_go_first(tmp_path: Path) -> None:
    backup = TP.made(2)
    folder, new = written(backup, tmp_path / "backup"), tmp_path / "new"
    answer = zerobeam("positions", "keep", folder, "--robot", TP.robot, "--entered", ZEROS, "-o", new)
    assert answer.status == 0
    assert answer.out.startswith("Converted. Approach P")
    assert "Load all files of it, or parts will disagree by up to" in answer.out.replace("\n", " ")
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


def said(*arguments: object) -> str:
    return " ".join(zerobeam("positions", *arguments).out.split())


def test_tools_and_frames_that_the_old_zeros_measured_are_named(tmp_path: Path) -> None:
    """All that the backup has but the null tool and frame, less what is stated to be measured again."""
    inform = DIALECTS["INFORM"]
    folder = written(inform.made(2), tmp_path / "backup")
    typed = ("keep", folder, "--robot", inform.robot, "--entered", ZEROS)
    text = said(*typed, "-o", tmp_path / "1")
    assert "measured with the old zeros, of tool 1, tool 7, frame 2 and frame 10: converted" in text
    assert "Workspaces and interference zones are not read" in text
    again = ("--new-tool", "1=1,2,3,4,5,6", "--new-tool", "7=1,2,3,4,5,6", "--new-frame", "2=1,2,3,4,5,6")
    audit = zerobeam("positions", *typed, "-o", tmp_path / "2", *again, "--json").json
    written_anew = {(one["what"], one["name"]) for one in audit["frames"] if one["new_numbers"] is not None}
    (note,) = [note for note in audit["notes"] if "old zeros" in note]
    for what, name in (("tool", "1"), ("tool", "7"), ("frame", "2")):
        assert (f"{what} {name}" in note) == ((what, name) not in written_anew)
    assert written_anew


def test_one_file_is_told_of_the_folder_that_has_its_tools(tmp_path: Path) -> None:
    krl = DIALECTS["KRL"]
    folder = written(krl.made(2), tmp_path / "backup")
    (program,) = [path for path in folder.rglob("*.src") if path.with_suffix(".dat").exists()][:1]
    (tmp_path / "alone").mkdir()
    for path in (program, program.with_suffix(".dat")):
        (tmp_path / "alone" / path.name).write_bytes(path.read_bytes())
    text = said("show", tmp_path / "alone" / program.name)
    assert "$config.dat of the backup may have what is to be stated: name the folder or zip" in text
    assert "$config.dat of the backup" not in said("show", folder)


def test_all_endings_are_in_the_help() -> None:
    text = zerobeam("positions", "show", "--help").out
    for endings in POSITIONS.values():
        for ending in endings.split(", "):
            assert ending in text


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
