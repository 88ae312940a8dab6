"""The recipes of CONTRIBUTING, followed: what they add is there by itself in commands, help, files and pages.
A maker is followed in tests/experiments/makers/test_makers.py, a kind of answer in test_kind_of_answer.py."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SUPPORT = Path(__file__).resolve().parents[1] / "support"
WITH_THE_STUDY = "import made_up_study; from zerobeam.cli import main; main()"


def zerobeam(*arguments: object, status: int = 0) -> str:
    command = [sys.executable, "-c", WITH_THE_STUDY, *map(str, arguments)]
    own = os.environ | {"PYTHONPATH": str(SUPPORT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
def test_a_study_is_pieces_a_page_and_an_entry(tmp_path: Path) -> None:
    assert "Is the mean of several readings" in zerobeam("study", "--help")
    assert "--runs" in zerobeam("study", "means", "--help")
    folder = tmp_path / "means"
    told = json.loads(zerobeam("study", "means", "-o", folder, "--runs", 200, "--json"))
    answer = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    assert {key: told[key] for key in answer} == answer
    assert answer["settings"] == {"runs": 200, "seed": 0}
    rows = list(csv.DictReader((folder / "means.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["readings"] for row in rows] == ["1", "4", "16"]
    page = (folder / "study.html").read_text(encoding="utf-8")
    assert "The truth is within 1.96 u as often as it should be." in page
    assert "Runs of each number of readings" in page
    assert (folder / "study.pdf").read_bytes().startswith(b"%PDF")
    assert not Path(f"{folder}.cases.jsonl").exists()


@pytest.mark.long
def test_a_study_of_other_words_needs_its_entry(tmp_path: Path) -> None:
    """Control: without the entry nothing of it is shown, and nothing is written."""
    without = "import made_up_study as m; m.STUDIES.pop('means'); from zerobeam.cli import main; main()"
    command = [sys.executable, "-c", without, "study", "means", "-o", str(tmp_path / "means")]
    own = os.environ | {"PYTHONPATH": str(SUPPORT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    assert done.returncode != 0
    assert not (tmp_path / "means").exists()
