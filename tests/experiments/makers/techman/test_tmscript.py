"""TMscript: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import techman_controller as controller
from damaged_files import joints_read, refused
from program_arm import plan_for

COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "tm5_900", controller.TARGET, count=5)
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"float[] zb_p{i} = {{{row}}}\n" for i, row in enumerate(rows)}
    motions = "".join(f'PTP("JPP",zb_p{i},5,500,0,false)\n' for i in lines)
    text = "define\n{\n" + "".join(lines.values()) + "}\nmain\n{\n" + motions + "}\n"
    read_joints = joints_read("tmscript", plan, tmp_path / "edited.tms")
    assert refused(read_joints, text, lines, count) < 0.9 * count
