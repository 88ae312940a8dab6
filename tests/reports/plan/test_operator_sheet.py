"""The sheet for the person at the robot: every posture with its picture, joints and fields."""

from __future__ import annotations

import io
import re
from pathlib import Path

from cells import good_plan
from command_line import plan_file, zerobeam
from pypdf import PdfReader


def test_a_page_for_each_posture_with_its_joints_and_fields(tmp_path: Path) -> None:
    plan = good_plan(3)
    path, file = plan_file(tmp_path / "plan.yaml", plan), tmp_path / "sheet.pdf"
    answer = zerobeam("export", "plan", "pdf", path, "-o", file)
    assert (answer.status, answer.err) == (0, "")
    pages = [page.extract_text() for page in PdfReader(io.BytesIO(file.read_bytes())).pages]
    assert len(pages) == 4
    for i, text in enumerate(pages[1:]):
        said = re.sub(r"\s+", " ", text).replace("−", "-")
        assert f"Posture {i}, target psd" in said
        for value in plan.postures[i] * plan.robot.display:
            assert f"{value:.3f}°" in said
        assert "recorded" in said
        assert "Beam to the target" in said
    assert "enabling switch" in pages[0]
    assert "exists already" in zerobeam("export", "plan", "pdf", path, "-o", file).refused()
    assert (
        "--zone is not for pdf"
        in zerobeam("export", "plan", "pdf", path, "-o", tmp_path / "b.pdf", "--zone", "5").refused()
    )
