"""What a file is, by what is in it; and the one clear error for what no importer reads."""

from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from recorded_logs import POSTURES, fanuc_listing, fanuc_position, kuka_list, kuka_point, moves, table, ur
from ros_bags import NAMES, Bag, file_of

from zerobeam.experiments.makers import contents as columns_found
from zerobeam.experiments.makers.contents import contents_of
from zerobeam.experiments.makers.maker import makers
from zerobeam.model.errors import BadInput

RAPID = "MODULE m\n  CONST jointtarget p1:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];\nENDMODULE\n"
STATES = "name:\n- a\n- b\nposition: [0.1, 0.2]\n---\nname: [a, b]\nposition: [0.3, 0.4]\n---\n"
EGM = table(["TIMESTAMP", *(f"R_FB_POS_RJ{i}" for i in range(1, 7))], [[0, 1, 2, 3, 4, 5, 6]], ",")
LOG = "12:00 zerobeam posture 0 deg 1 2 3 4 5 6\n12:01 zerobeam posture 1 deg 1 2 3 4 5 6\n"
ONE, TWO = "1 points, 1 with joint values", "2 points, 1 with joint values"
JOB = "/JOB\n//NAME A\n//POS\n///NPOS 1,0,0,0,0,0\n///PULSE\nC00000=1,2,3,4,5,6\n//INST\nNOP\nEND\n"
DATABASE = """<?xml version="1.0" encoding="utf-8"?>
<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas>
<Data name="a" access="public" xsi:type="array" type="jointRx" size="1">
<Value key="0" j1="1" j2="2" j3="3" j4="4" j5="5" j6="6"/></Data></Datas></Database>
"""
FILES = {
    "a.ls": (
        fanuc_listing("".join(map(fanuc_position, range(1, 5), POSTURES))),
        "fanuc",
        "4 points, 4 with joint values",
    ),
    "a.dat": (kuka_list(kuka_point("XP1", POSTURES[0])), "krl", ONE),
    "a.jbi": (JOB, "inform", ONE),
    "a.as": (".JOINTS\n#p1 1 2 3 4 5 6\n.END\n.TRANS\nt1 1 2 3 4 5 6\n.END\n", "as", TWO),
    "a.dtx": (DATABASE, "val3", ONE),
    "a.prg": ("J1=(1,2,3,4,5,6)\nP1=(1,2,3,4,5,6)(7,0)\n", "melfa", TWO),
    "a.drl": ("a = posj(1, 2, 3, 4, 5, 6)\nb = posx(1, 2, 3, 4, 5, 6)\n", "drl", TWO),
    "a.tms": ('define\n{\n}\nmain\n{\nPTP("JPP",1,2,3,4,5,6,5,500,0,false)\n}\n', "tmscript", ONE),
    "a.001": ("MOVEX A=1,M1J,P,(1,2,3,4,5,6),R=5.0,H=1,MS\nEND\n", "slim", ONE),
    "a.pcs": ("Sub Main\nzb_p0 = J(1, 2, 3, 4, 5, 6)\nEnd Sub\n", "pacscript", ONE),
    "a.txt": ("a = [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\n", "franka", ONE),
    "a.mod": (RAPID, "rapid", ONE),
    "a.yaml": (STATES, "joint states", "2 messages, each a measurement"),
    "ur.csv": (ur(*moves()), "log ur", "349 rows of 14 columns"),
    "egm.csv": (EGM, "log egm", "1 rows of 7 columns"),
    "zb.log": (LOG, "program log", "2 postures"),
    "plan.yaml": ("schema: zerobeam/plan/1\n", "ours", "a file of zerobeam: plan"),
    "plain.csv": ("1,2\n3,4\n", "csv", "2 rows of 2 columns"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_recognised_by_what_is_in_it(tmp_path: Path, name: str) -> None:
    text, form, count = FILES[name]
    path = tmp_path / "no_suffix"
    path.write_text(text)
    found = contents_of(path)
    assert (found.form, found.count) == (form, count)
    assert found.why
    assert found.form == "ours" or found.formats


def test_every_reader_of_positions_recognises_them(tmp_path: Path) -> None:
    """A maker whose programs have positions that an import chooses from says how they are recognised."""
    readers = [each for maker in makers() for each in maker.read if not each.hidden]
    choosing = {each.name for each in readers if "points" in signature(each.read).parameters}
    assert choosing == {each.name for each in readers if each.marks}
    assert choosing <= {form for _, form, _ in FILES.values()}
    (tmp_path / "zb.log").write_text(LOG)
    assert set(contents_of(tmp_path / "zb.log").formats) == {
        each.name for each in readers if each.program_log
    }


def test_positions_of_a_plans_program_are_not_chosen_among(tmp_path: Path) -> None:
    path = tmp_path / "a.as"
    path.write_text(".JOINTS\n#zb_p0 1 2 3 4 5 6\n#zb_m0 1 2 3 4 5 6\n.END\n")
    assert (contents_of(path).count, contents_of(path).points) == ("2 points, 2 with joint values", ())


def test_a_bag_has_topics_and_joints(tmp_path: Path) -> None:
    bag = Bag("mcap").states([0.0, 0.1], POSTURES[:2]).marker(0.05, "a").write(tmp_path)
    found = contents_of(file_of(bag))
    assert (found.form, found.count) == ("ros", "2 joint states on /joint_states")
    assert [(t.name, t.messages, t.joints) for t in found.topics] == [
        ("/joint_states", 2, tuple(NAMES)),
        ("/shot", 1, ()),
    ]


def test_a_table_is_described_as_it_is_laid_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;a1;note\n0,5;-1,25;x\n1,5;3,5;y\n")
    found = contents_of(path)
    assert (found.layout.header_row, found.layout.delimiter, found.layout.decimal) == (True, ";", ",")
    time, first, note = found.columns
    assert (time.lowest, time.highest) == (0.5, 1.5)
    assert (first.stated, first.lowest, first.highest) == ("a1", -1.25, 3.5)
    assert (note.lowest, note.other, note.line) == (None, '"x"', 2)


def test_columns_aligned_with_blanks_and_names_that_cannot_be_stated(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("  1.0   2.0\n 10.0  20.0\n")
    assert [column.highest for column in contents_of(path).columns] == [10.0, 20.0]
    path.write_text('"a,1";7;b=2\n1;2;3\n')
    assert [column.stated for column in contents_of(path).columns] == ["1", "2", "3"]


BAD = {
    "empty": (b"", "the file is empty"),
    "blank lines": (b"\n\n \n", "the file is empty"),
    "utf-16": ("a;1\n1;2\n".encode("utf-16"), "the text is UTF-16"),
    "binary": (b"\x00\x01\x02" * 100, "binary file"),
    "ragged": (b"1,2,3\n1,2\n", "wrong number of values"),
    "prose": (b"Dear all,\nplease find\n", "no column of numbers"),
    "ur calibration": (b"delta_theta = [0]\ndelta_alpha = [0]\n", "not a recording"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_no_importer_reads_has_one_clear_error(tmp_path: Path, name: str) -> None:
    content, said = BAD[name]
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=said):
        contents_of(path)


def test_of_a_large_table_the_first_part_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{i},{i}\n" for i in range(1000)))
    monkeypatch.setattr(columns_found.head_of, "__defaults__", (1000,))
    found = contents_of(path)
    assert not found.whole
    assert 0 < found.rows < 300
    assert "in its first part" in found.count
    assert np.isclose(found.columns[0].highest or 0, found.rows - 1)
