"""A Yaskawa controller as far as the tests need it: it runs jobs, and saves them with modified positions.

Written from the manuals, without the code that is tested. The pulses of the arm are made up.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN

TARGET = (600.0, 0.0, 100.0)
KIND, READER, SUFFIX = "inform", "inform", ".jbi"
PULSES = np.array([1341.4, -1365.3, 1205.0, 1001.25, -980.5, 455.1])
STEP_DEG = 0.51 / 455.1  # half a pulse
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


def _values(pose: Matrix) -> str:
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join([*(f"{value:.3f}" for value in pose[:3, 3]), *(f"{value:.4f}" for value in turns)])
