"""Joint lists in radians: what is written, what is read, damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cells import good_plan
from damaged_files import joints_read, refused
from program_arm import plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput

TARGET = (450.0, 0.0, 0.0)


def test_the_list_has_the_postures_in_radians(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=3)
    path = tmp_path / "zb_plan.py"
    write_program("franka", plan, ProgramMotion(), path)
    names: dict[str, list[float]] = {}
    exec(path.read_text(), {}, names)
    np.testing.assert_allclose([names[f"zb_p{i}"] for i in range(3)], plan.postures, atol=1e-11)
    with pytest.raises(BadInput, match="no measurements found"):  # nothing was recorded yet
        joints_read("franka", plan, path)(path.read_text())


def test_the_arm_of_another_maker_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="a joint list of libfranka is for robots of Franka"):
        write_program("franka", good_plan(3), ProgramMotion(), tmp_path / "zb_plan.py")


def test_degrees_are_refused(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=1)
    text = f"zb_m0 = {np.degrees(plan.postures[0] + 0.002).tolist()}\n"
    with pytest.raises(BadInput, match="is not at the plan's posture"):
        joints_read("franka", plan, tmp_path / "recorded.py")(text)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=5)
    rows = [", ".join(f"{value:.9f}" for value in row) for row in plan.postures + 0.002]
    lines = {i: f"zb_m{i} = [{row}]\n" for i, row in enumerate(rows)}
    read_joints = joints_read("franka", plan, tmp_path / "recorded.py")
    assert refused(read_joints, "# recorded\n" + "".join(lines.values()), lines, count) < 0.9 * count
