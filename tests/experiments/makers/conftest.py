"""What the tests of imports and of programs start from."""

from pathlib import Path

import pytest
from recorded_logs import HEADER


@pytest.fixture
def header(tmp_path: Path) -> Path:
    """A header of a run by a probe, for the recorded files of `recorded_logs`."""
    path = tmp_path / "header.yaml"
    path.write_text(HEADER)
    return path
