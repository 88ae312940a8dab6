"""AS: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

from pathlib import Path

import kawasaki_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, refused
from program_arm import plan_for

from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("rs007n")
COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
JOB = """.PROGRAM job()
  TOOL TRANS(0,0,0,0,0,0)
  BASE TRANS(0,0,0,0,0,0)
  JMOVE #home
{}
.END
.JOINTS
#home 0 10 -80 0 -90 0
{}
.END
"""


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "rs007n", controller.TARGET, count=5)
    rows = [" ".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"#zb_m{i} {row}\n" for i, row in enumerate(rows)}
    text = ".JOINTS\n" + "".join(lines.values()) + ".END\n"
    read_joints = joints_read("as", plan, tmp_path / "saved.as")
    assert refused(read_joints, text, lines, count) < count
