"""A Yaskawa controller as far as the tests need it: it runs jobs, and saves them with modified positions.

Written from the manuals, without the code that is tested. The pulses of the arm are made up.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, flange_arm, frame, solved_pose

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN
from zerobeam.model.kinematics.robot import Robot

TARGET = (600.0, 0.0, 100.0)
KIND, READER, SUFFIX = "inform", "inform", ".jbi"
PULSES = np.array([1341.4, -1365.3, 1205.0, 1001.25, -980.5, 455.1])
STEP_DEG = 0.51 / 455.1  # half a pulse
DIGITS_MM = 0.05  # half a pulse of each axis
STATED = ProgramOptions(tools=["3=10,-5,120,0,30,20"], frames=["2=300,-100,50,0,0,15"])
MODIFIABLE = re.compile(r"^(C\d{5})=([-\d,]+)$", re.MULTILINE)


def robot_file(folder: Path) -> str:
    """The GP7 of a person, with the pulses of the machine."""
    text = (BUILT_IN / "gp7.yaml").read_text()
    pulses = ", ".join(map(str, PULSES))
    pendant = f"pendant: {{joint3: link, names: [S, L, U, R, B, T], unit: pulse, pulses_per_deg: [{pulses}]}}"
    path = folder / "mine.yaml"
    path.write_text(re.sub(r"^pendant:.*$", pendant, text, flags=re.MULTILINE))
    return str(path)


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The job after it has run, with the position of each pause modified where the arm was then."""
    text = program.read_text().replace("\r\n", "\n")
    head, body = text.split("//INST\n")
    assert head.startswith(f"/JOB\n//NAME {program.stem.upper()}\n//POS\n///NPOS ")
    assert "///POSTYPE PULSE\n///PULSE\nC00000=" in head
    positions = {name: [int(value) for value in row.split(",")] for name, row in MODIFIABLE.findall(head)}
    assert int(re.search(r"NPOS (\d+),0,0,0,0,0\n", head)[1]) == len(positions)
    here = ""
    for line in body.splitlines():
        assert len(line) <= 32 or line.startswith("MSG"), line
        if motion := re.fullmatch(r"MOVJ (C\d{5}) VJ=(\d+\.\d\d) PL=0", line):
            assert 0.01 <= float(motion[2]) <= 100
            here = motion[1]
            arm.move(np.array(positions[here]) / PULSES)
        elif line == "PAUSE":
            arm.centre()
            positions[here] = np.round(np.array(arm.joints()) * PULSES).astype(int).tolist()
        else:
            assert re.fullmatch(r"'.*|NOP|END|///(DATE|ATTR|GROUP1) .*|MSG \"[^\"]{1,32}\"|", line), line
    saved = program.with_name("saved.jbi")
    rows = MODIFIABLE.sub(lambda match: f"{match[1]}={','.join(map(str, positions[match[1]]))}", text)
    saved.write_bytes(rows.replace("\n", "\r\n").encode())
    return saved


def positions_of(job: str) -> list[tuple[int, str]]:
    """Numbers and values of its positions."""
    return [(int(name[1:]), row) for name, row in MODIFIABLE.findall(job.replace("\r\n", "\n"))]


def rconf(row: Matrix) -> str:
    """Flip, upper arm, front by the side view of the GP7's data sheet; no axis beyond half a turn."""
    lower, fore = np.radians(row[1]), np.radians(row[2] - row[1])
    arm = 445 * np.array([np.sin(lower), np.cos(lower)])
    centre = 440 * np.array([np.cos(fore), np.sin(fore)]) + 40 * np.array([-np.sin(fore), np.cos(fore)])
    behind = 40 + arm[0] + centre[0] < 0
    above = arm[0] * centre[1] - arm[1] * centre[0] < 0
    assert (np.abs(row[[0, 3, 5]]) < 180).all()
    return f"{int(row[4] < 0)},{int(not above)},{int(behind)},0,0,0,0,0"


def _values(pose: Matrix) -> str:
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join([*(f"{value:.3f}" for value in pose[:3, 3]), *(f"{value:.4f}" for value in turns)])


def user_program(robot: Robot, rows: Matrix) -> str:
    """As a controller saves it: positions in pulses, then poses, each with its configuration."""
    poses = np.linalg.inv(TABLE) @ flange_arm(robot).fk(rows, "deg") @ TOOL
    pulses = [",".join(str(round(value)) for value in row * PULSES) for row in rows]
    joints = [f"C{(100 if i % 2 else 0) + i:05d}={row}" for i, row in enumerate(pulses)]
    cartesian = [
        line
        for i in range(1, len(rows), 2)
        for line in (f"///RCONF {rconf(rows[i])}", f"C{i:05d}={_values(poses[i])}")
    ]
    moves = []
    for i in range(len(rows)):
        near = [f"MOVJ C{100 + i:05d} VJ=50.00"] if i % 2 else []
        moves += [*near, f"{'MOVL' if i % 2 else 'MOVJ'} C{i:05d} {'V=100.0 PL=1' if i % 2 else 'VJ=50.00'}"]
    return "\r\n".join(
        [
            *("/JOB", "//NAME JOB", "//POS", f"///NPOS {len(joints) + len(rows) // 2},0,0,0,0,0"),
            *("///TOOL 3", "///POSTYPE PULSE", "///PULSE", *joints),
            *("///USER 2", "///POSTYPE USER", "///RECTAN", *cartesian),
            *("//INST", "///DATE 2020/01/01 12:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"),
            *("'caf\xe9", *moves, "DOUT OT#(3) ON", "TIMER T=1.00", "END", ""),
        ]
    )


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller of the nominal arm commands at each motion to C00000, C00001, …"""
    result = []
    for i, row in enumerate(rows):
        values = [
            float(value) for value in re.search(rf"^C{i:05d}=(.*?)\r?$", text, re.MULTILINE)[1].split(",")
        ]
        if i % 2:
            result.append(solved_pose(robot, TABLE @ frame(*values) @ np.linalg.inv(TOOL), row))
            assert rconf(result[-1]) == rconf(row)
        else:
            result.append(np.array(values) / PULSES)
    return np.array(result)
