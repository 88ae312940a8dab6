"""AS: damaged files."""

from __future__ import annotations

from pathlib import Path

import kawasaki_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, refused
from import_files import positions_of
from program_arm import plan_for

from zerobeam.model.errors import BadInput

COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "rs007n", controller.TARGET, count=5)
    rows = [" ".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"#zb_m{i} {row}\n" for i, row in enumerate(rows)}
    text = ".JOINTS\n" + "".join(lines.values()) + ".END\n"
    read_joints = joints_read("as", plan, tmp_path / "saved.as")
    assert refused(read_joints, text, lines, count) < count


def test_a_line_of_digits_is_no_endless_search() -> None:
    with pytest.raises(BadInput, match="not understood"):
        positions_of("as", f".JOINTS\n#a {'1' * 400}x\n.END\n", Path("a.as"))
