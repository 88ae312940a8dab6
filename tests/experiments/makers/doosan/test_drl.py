"""DRL: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

from pathlib import Path

import doosan_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, refused
from program_arm import plan_for

COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])


@pytest.mark.parametrize("reader", ["program", "log"])
@COUNTS
def test_damaged_recordings(tmp_path: Path, reader: str, count: int) -> None:
    plan = plan_for(tmp_path, "m1013", controller.TARGET, count=5)
    rows = np.degrees(plan.postures) + 0.123456
    if reader == "program":
        lines = {i: f"zb_p{i} = posj({', '.join(f'{v:.6f}' for v in row)})\n" for i, row in enumerate(rows)}
        text = "# zerobeam plan\n" + "".join(f"{line}movej(zb_p{i})\n" for i, line in lines.items())
    else:
        values = [" ".join(f"{v:.6f}" for v in row) for row in rows]
        lines = {i: f"zerobeam posture {i} deg {row}\n" for i, row in enumerate(values)}
        text = "".join(f"10:00:0{i}  {line}" for i, line in lines.items())
    read_joints = joints_read("drl", plan, tmp_path / "recorded.drl")
    assert refused(read_joints, text, lines, count) < 0.9 * count
