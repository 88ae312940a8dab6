"""FANUC and KUKA joint lists, written here as their controllers print them."""

from pathlib import Path

import numpy as np
import pytest
from fanuc_interpreter import registers_text
from import_files import import_fanuc, import_kuka
from recorded_logs import HEADER, POSTURES, fanuc_listing, fanuc_position, kuka_list, kuka_point

from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.run import read_run, write_run

CARTESIAN = """P[9]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   430.291  mm,\tY =    24.486  mm,\tZ =   282.316  mm,
\tW =      .568 deg,\tP =     1.060 deg,\tR =   -90.260 deg
};
"""
RAIL = "   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=     0.000  mm\n"


POSE = "DECL E6POS XP9={X 10.0,Y 20.0,Z 30.0,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 0.0}\n"


@pytest.fixture
def fanuc(tmp_path, header):
    def read(positions, j3="link", points=None, text=None):
        path = tmp_path / "shots.ls"
        path.write_text(fanuc_listing(positions) if text is None else text)
        return import_fanuc([path], ["a"], header, tmp_path / "run.jsonl", j3=j3, points=points)

    return read


@pytest.fixture
def kuka(tmp_path, header):
    def read(points, names=None, text=None):
        path = tmp_path / "shots.dat"
        path.write_text(kuka_list(points) if text is None else text)
        return import_kuka([path], ["a"], header, tmp_path / "run.jsonl", points=names)

    return read


def joints(found):
    return np.array([shot.joints_deg for shot in found.shots])


def test_fanuc_positions_of_the_first_group(fanuc, tmp_path):
    text = "".join(fanuc_position(i + 1, row, "on target", RAIL) for i, row in enumerate(POSTURES))
    found = fanuc(text)
    np.testing.assert_array_equal(joints(found), POSTURES)
    assert "  points in their order: 1, 2, 3, 4" in found.understood
    assert "FANUC positions of group 1, angles in degrees, joint 1 first" in found.understood
    write_run(tmp_path / "run.jsonl", found.header, found.shots)
    assert len(read_run(tmp_path / "run.jsonl").shots) == 4


def test_joint_3_from_the_ground(fanuc, refused):
    """Joint 2 alone moves by 15 degrees: the pendant shows the same J3, the angle at the elbow changes."""
    rows = POSTURES[[0, 0]].copy()
    rows[1, 1] += 15
    text = fanuc_position(1, rows[0]) + fanuc_position(2, rows[1])
    found = fanuc(text, j3="ground")
    assert joints(found)[1, 2] - joints(found)[0, 2] == pytest.approx(15)
    np.testing.assert_array_equal(joints(found)[:, 2], rows[:, 2] + rows[:, 1])
    np.testing.assert_array_equal(np.delete(joints(found), 2, axis=1), np.delete(rows, 2, axis=1))
    note = "joint 3 is counted from the ground, as --j3 states: J2 + J3 is the angle between links 2 and 3"
    assert note in found.understood
    plain = fanuc(text, j3="link")
    np.testing.assert_array_equal(joints(plain), rows)
    assert note not in plain.understood
    assert "reference of joint 3" in refused(fanuc, text, j3="base").what


def test_numbers_as_fanuc_prints_them(fanuc):
    row = fanuc_position(1, POSTURES[0]).replace("   10.000", "    -.350").replace("   20.000", "     .500")
    np.testing.assert_array_equal(joints(fanuc(row))[0, :2], [-0.35, 0.5])


def test_fanuc_points_that_are_not_joints(fanuc, refused):
    text = fanuc_position(1, POSTURES[0]) + CARTESIAN + fanuc_position(3, POSTURES[1])
    error = refused(fanuc, text)
    assert "point 9 has no joint values" in error.what
    assert error.line == 13
    found = fanuc(text, points=["3", "1"])
    np.testing.assert_array_equal(joints(found), POSTURES[[1, 0]])
    assert refused(fanuc, text, points=["2"]).allowed == "1, 9, 3"
    untaught = fanuc_position(1, POSTURES[0]).replace("   40.000", "*********")
    assert "cannot be read" in refused(fanuc, untaught).what
    short = fanuc_position(1, POSTURES[0][:5])
    assert "wrong number of joints" in refused(fanuc, short).what
    assert "no measurements found" in refused(fanuc, "").what


def test_a_fanuc_file_that_is_none_or_breaks_off(fanuc, refused):
    assert "not a TP program" in refused(fanuc, "", text="P[1] 1 2 3\n").what
    torn = fanuc_listing(fanuc_position(1, POSTURES[0])).replace("/END\n", "")
    assert "no whole listing" in refused(fanuc, "", text=torn).what
    two = fanuc_position(1, POSTURES[0]) + fanuc_position(2, POSTURES[1])
    error = refused(fanuc, two.replace("};", "}", 1))
    assert "this position is not understood" in error.what
    assert error.line == 7


def test_kuka_axis_positions(kuka, tmp_path):
    text = kuka_point("XP1", POSTURES[0]) + kuka_point("XP2", POSTURES[1], "AXIS", "}")
    text += kuka_point("XP3", POSTURES[2], "GLOBAL E6AXIS").replace("DECL GLOBAL", "decl global")
    found = kuka(text)
    np.testing.assert_array_equal(joints(found), POSTURES[:3])
    assert "  points in their order: XP1, XP2, XP3" in found.understood
    write_run(tmp_path / "run.jsonl", found.header, found.shots)
    assert len(read_run(tmp_path / "run.jsonl").shots) == 3


def test_external_axes_are_ignored_and_said(kuka):
    on_a_track = kuka_point("XP2", POSTURES[1]).replace("E1 0.0", "E1 1200.0")
    found = kuka(kuka_point("XP1", POSTURES[0]) + on_a_track)
    np.testing.assert_array_equal(joints(found), POSTURES[:2])
    (note,) = (line for line in found.understood if "external axes are not at 0" in line)
    assert "in XP2, and are ignored" in note


def test_kuka_arrays_of_positions(kuka):
    text = "DECL E6AXIS SHOT[2]\n" + kuka_point("SHOT[1]", POSTURES[0]).removeprefix("DECL E6AXIS ")
    text += kuka_point("SHOT[2]", POSTURES[1]).removeprefix("DECL E6AXIS ").replace("{", "{E6AXIS: ")
    text = text.replace(",A4", ",\n   A4")
    found = kuka(text)
    np.testing.assert_array_equal(joints(found), POSTURES[:2])
    assert "  points in their order: SHOT[1], SHOT[2]" in found.understood


def test_kuka_points_that_cannot_be_used(kuka, refused):
    text = kuka_point("XP1", POSTURES[0]) + POSE + ";" + kuka_point("XP4", POSTURES[1])
    error = refused(kuka, text)
    assert "point XP9 has no joint values" in error.what
    assert error.line == 6
    assert len(kuka(text, ["XP1"]).shots) == 1
    assert refused(kuka, text, ["XP"]).allowed == "XP1, XP9"
    turned = kuka_point("XP1", POSTURES[0]).replace("A2", "A9")
    assert "point XP1 cannot be read" in refused(kuka, turned).what
    assert "cannot be read" in refused(kuka, kuka_point("XP1", POSTURES[0], ends="")).what
    assert "cannot be read" in refused(kuka, kuka_point("XP1", POSTURES[0], ends=",E1 0.0")).what
    assert "cannot be read" in refused(kuka, kuka_point("XP1", POSTURES[0]).replace("40.0", "4_0.0")).what
    assert "no measurements found" in refused(kuka, "").what
    assert "is incomplete" in refused(kuka, "", text=kuka_list(text).replace("ENDDAT", "")).what


def test_points_that_a_program_beside_overwrites_are_left_out(kuka, refused, tmp_path):
    text = kuka_point("XP1", POSTURES[0]) + kuka_point("XP2", POSTURES[1])
    assert len(kuka(text).shots) == 2
    (tmp_path / "shots.src").write_text("DEF shots()\nPTP XP1\nXP2.A1=XP2.A1+5\nPTP XP2\nEND\n")
    found = kuka(text)
    np.testing.assert_array_equal(joints(found), POSTURES[:1])
    left_out = "note: left out, overwritten when the program runs (shots.src, line 3): line 6 (XP2)"
    assert f"  {left_out}" in found.understood
    named = kuka(text, ["XP2"])
    assert (
        "  note: XP2 is as stored: overwritten when the program runs (shots.src, line 3)" in named.understood
    )
    (tmp_path / "shots.src").write_text("DEF shots()\nXP1=$AXIS_ACT\nXP2=$AXIS_ACT\nEND\n")
    assert "overwritten when the program runs (shots.src, line 2)" in refused(kuka, text).found


def test_limits_hold_for_points_too(kuka, refused):
    far = POSTURES.copy()
    far[1, 4] = 140
    error = refused(kuka, "".join(kuka_point(f"XP{i}", row) for i, row in enumerate(far)))
    assert "point 2: joint 5 is outside its limits" in error.what
    assert error.line == 6
    radians = np.radians(POSTURES)
    told = kuka("".join(kuka_point(f"XP{i}", row) for i, row in enumerate(radians))).understood
    assert told[-1].startswith("note: radians?")


def test_position_registers_that_hold_joints(fanuc, refused):
    held = {1: POSTURES[0], 3: [999.0, *POSTURES[1][1:]], 7: POSTURES[2], 9: POSTURES[3]}
    text = registers_text(held, 20).replace("[1,7] =   ''", "[1,7] =   'J1= 5 deg'")
    cartesian = "    [1,21] =   '' \n  Group: 1   Config: N U T, 0, 0, 0\n  X: 1.0   Y: 2.0   Z: 3.0\n"
    cartesian += "  W: 1.0   P: 2.0   R: 3.0\n"
    other = "    [2,1] =   ''   Group: 2\n  J1 =     7.000 deg\n[*POSREG*]$MAXPREGNUM  : INTEGER = 20\n"
    found = fanuc(None, text=text + cartesian + other)
    np.testing.assert_array_equal(joints(found), POSTURES[[0, 2, 3]])
    assert "  points in their order: 1, 7, 9" in found.understood
    error = refused(fanuc, None, points=["21"], text=text + cartesian + other)
    assert error.what == "point 21 has no joint values"


def test_registers_of_a_plan_are_its_postures(tmp_path, header):
    plan = planned(tmp_path)
    held = {4: POSTURES[0], 5: POSTURES[0] + 0.5, 6: [999.0, *POSTURES[1][1:]], 7: POSTURES[2] + 0.5}
    (tmp_path / "posreg.va").write_text(registers_text({**held, 9: POSTURES[3]}, 20))
    found = import_fanuc([tmp_path / "posreg.va"], [], plan, tmp_path / "run.jsonl", j3="link", register=5)
    assert [shot.shot for shot in found.shots] == [0, 2]
    np.testing.assert_array_equal(joints(found), POSTURES[[0, 2]] + 0.5)


def test_what_a_plan_has_recorded_in_a_data_list(tmp_path, kuka):
    points = [kuka_point(f"ZB_P{i}", row) for i, row in enumerate(POSTURES)]
    points += [kuka_point(f"ZB_M{i}", row + 0.5) for i, row in enumerate(POSTURES)]
    points += [f"DECL BOOL ZB_D{i}={said}\n" for i, said in enumerate(["TRUE", "FALSE", "true", "FALSE"])]
    text = kuka_list("".join(points)).replace("ENDDAT", ";ZB_D3=TRUE\nENDDAT")
    (tmp_path / "zb_plan.dat").write_text(text)
    found = import_kuka([tmp_path / "zb_plan.dat"], [], planned(tmp_path), tmp_path / "run.jsonl")
    assert [shot.shot for shot in found.shots] == [0, 2]
    np.testing.assert_array_equal(joints(found), POSTURES[[0, 2]] + 0.5)
    assert len(kuka(None, names=["ZB_M1"], text=text).shots) == 1


def planned(folder: Path):
    rows = "".join(f"  - {row.tolist()}\n" for row in POSTURES)
    (folder / "plan.yaml").write_text(f"schema: zerobeam/plan/1\n{HEADER}postures_deg:\n{rows}")
    return read_plan(folder / "plan.yaml")
