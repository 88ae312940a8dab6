"""What the tests of imports and of programs start from."""

from pathlib import Path

import pytest
from recorded_logs import HEADER

from zerobeam.experiments.makers import user_programs
from zerobeam.experiments.makers.solving import Corrections


@pytest.fixture
def header(tmp_path: Path) -> Path:
    """A header of a run by a probe, for the recorded files of `recorded_logs`."""
    path = tmp_path / "header.yaml"
    path.write_text(HEADER)
    return path


@pytest.fixture
def unsolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """No target of a program is solved, which takes long: for what is refused as it is read."""
    none = Corrections([], [], [], [])
    monkeypatch.setattr(user_programs, "correct_targets", lambda parsed, arms, near: none)
