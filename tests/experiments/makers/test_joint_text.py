from __future__ import annotations

from dataclasses import replace

import pytest

from zerobeam.experiments.makers.joint_text import joints_so_far, labelled, typed_joints
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.pendant import pendant_of

VALUES = (1.2, 3.0, -4.0, 5.0, 6.0, 7.5)


@pytest.mark.parametrize(
    "text",
    [
        "1.2 3 -4 5 6 7.5",
        "1.2, 3, -4, 5, 6, 7.5",
        "1.2,3,-4,5,6,7.5",
        "1.2;3;-4;5;6;7.5",
        "1.2\t3\t-4\t5\t6\t7.5\n",
        "1,2\t3\t-4\t5\t6\t7,5",
        "1,2; 3,0; -4,0; 5,0; 6,0; 7,5",
        "[1.2, 3.0, -4.0, 5, 6, 7.5]",
        "(1.2 3 −4 5 6 7.5)",
        "1.2° 3° -4° 5° 6° 7.5°",
        "[[1.2,3,-4,5,6,7.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]",
        "CONST jointtarget p10:=[[1.2,3,-4,5,6,7.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];",
        "{A1 1.2,A2 3,A3 -4,A4 5,A5 6,A6 7.5,E1 0.0,E2 0.0}",
        "DECL E6AXIS XP1={A1 1.2,A2 3,A3 -4,A4 5,A5 6,A6 7.5}",
        "J1=     1.200 deg,\tJ2=  3.0 deg,\tJ3= -4 deg,\nJ4= 5.0 deg,\tJ5= 6 deg,\tJ6= 7.5 deg",
        "J6: 7.5 J1: 1.2 J2: 3 J3: -4 J4: 5 J5: 6",
        "Joint 1 1,2\nJoint 2 3\nJoint 3 -4\nJoint 4 5\nJoint 5 6\nJoint 6 7,5",
        "q0=1.2 q1=3 q2=-4 q3=5 q4=6 q5=7.5",
        "S 1.2 L 3 U -4 R 5 B 6 T 7.5",
        "S 1.2\nL 3\nU -4\nR 5\nB 6\nT 7.5",
        "1.2\n3\n-4\n5\n6\n7.5",
        "1.2 | 3 | -4 | 5 | 6 | 7.5",
        "+1.2 3. -4 5e0 6 0.75E1".replace("3. ", "3 "),
    ],
)
def test_common_forms(text: str) -> None:
    assert typed_joints(text, 6).values == VALUES


@pytest.mark.parametrize(
    ("text", "unit"),
    [("[1, 2] rad", "rad"), ("1 deg, 2 deg", "deg"), ("1° 2°", "deg"), ("1 2", None)],
)
def test_a_stated_unit_is_heard(text: str, unit: str | None) -> None:
    assert typed_joints(text, 2).unit == unit


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no numbers"),
        ("1 2 3 4 5", "5 numbers"),
        ("1 2 3 4 5 6 7", "7 numbers"),
        ("1 2 3 four 5 6", "no numbers"),
        ("X 100, Y 200, Z 300, A 0, B 90, C 0", "Cartesian"),
        ("{X 100,Y 200,Z 300,A 0,B 90,C 0,S 2,T 35}", "Cartesian"),
        ("J1= 1 deg, J2= 2 deg", "none for joint 3, 4, 5, 6"),
        ("1 2 3 nan 5 6", "no numbers"),
        ("\x1b[31m1 2", r"\u001b"),
    ],
)
def test_what_cannot_be_meant_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput) as error:
        typed_joints(text, 6)
    assert said in str(error.value)


def test_labels_by_number() -> None:
    assert labelled("J1: 10 J3: −5") == {1: 10.0, 3: -5.0}
    assert labelled("1 2 3") == {}
    assert labelled("T 5 S 2") == {}  # KUKA's status and turn


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("S 1.2", 1),
        ("S: 1.2 deg L: -3,5 deg", 2),
        ("S 1000 pulses L 2000 pulses U 3 R 4 B 5 T 6", 6),
        ("1.2", 1),
        ("1.2 −3,5", 2),
        ("J1= 10 deg", 1),
        ("S 2 T 35", 0),
        ("T 5", 0),
        ("[1.2", 0),
        ("pause", 0),
    ],
)
def test_joints_that_are_begun(text: str, count: int) -> None:
    assert joints_so_far(text) == count


def test_values_without_names_are_in_the_pendants_order_and_names_are_the_pendants() -> None:
    own = replace(load_robot("gp7").conventions, order=(0, 1, 5, 2, 3, 4))
    pendant = pendant_of(replace(load_robot("gp7"), conventions=own))
    assert typed_joints("1 2 6 3 4 5", 6, pendant).values == (1, 2, 3, 4, 5, 6)
    assert typed_joints("T 6, S 1, L 2, U 3, R 4, B 5", 6, pendant).values == (1, 2, 3, 4, 5, 6)
    assert typed_joints("1 2 6 3 4 5 pulses", 6, pendant).unit == "pulse"
    assert labelled("Wrist 2: 5 deg, Base: −10", ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2"]) == {
        1: -10.0,
        5: 5.0,
    }
