"""SLIM: joint positions there and corrected, what is refused, and damaged programs."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from damaged_files import damaged
from recorded_logs import HEADER
from user_programs import OFFSETS, judged, read, varied

from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.recordings import ImportJob
from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN, load_robot
from zerobeam.model.kinematics.robot import Robot

READER = next(each for maker in makers() for each in maker.read if each.name == "slim")
FILES = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])


def robot_text() -> str:
    """The lengths of a built-in arm of another maker: what is tested are the files."""
    text = (BUILT_IN / "rs007n.yaml").read_text().replace("vendor: kawasaki", "vendor: nachi")
    return text.replace("name: rs007n", "name: mine").replace("model: RS007N", "model: mine")


@cache
def arm() -> Robot:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mine.yaml"
        path.write_text(robot_text())
        return load_robot(str(path))


def program(rows: np.ndarray, line: str = "SET [01]") -> str:
    moves = [
        f"MOVEX A={i % 8 + 1},AC=0,SM=0,M1J,{'PL'[i % 2]},({','.join(f'{value:.3f}' for value in row)}),"
        f"{'RS'[i % 2]}=10.0,H=1,MS"
        for i, row in enumerate(rows)
    ]
    return "\r\n".join(["' caf\xe9", *moves, line, "END", ""])


def joints(text: str) -> np.ndarray:
    return np.array([list(map(float, row.split(","))) for row in re.findall(r"M1J,[PL],\(([^()]*)\)", text)])


def corrected(folder: Path, text: str) -> str:
    (folder / "in.slim").write_bytes(text.encode())
    return read(corrected_program(arm(), judged(arm()), folder / "in.slim", folder / "out.slim"))


def test_joints_are_corrected_and_the_flange_is_where_it_is_meant(tmp_path: Path) -> None:
    rows = varied(arm(), 4)[[0, 0, 1, 1]]  # each line ends where it begins
    text = corrected(tmp_path, program(rows))
    true = arm().with_offsets(np.radians(OFFSETS))
    assert np.abs((true.fk(joints(text), "deg") - arm().fk(rows, "deg"))[:, :3, 3]).max() < 0.05
    assert np.abs((true.fk(rows, "deg") - arm().fk(rows, "deg"))[:, :3, 3]).max() > 1
    assert text.startswith("'zerobeam export program\r\n")


@pytest.mark.parametrize(
    "line",
    [
        "MOVEX A=1,AC=0,SM=0,M1X,L,(400,0,300,0,0,180),S=60.0,H=1,MS,CONF=0000",
        "MOVEX A=1,M1J,P,(0,0,0,0,30,0),R=5.0,H=1,MS,M2J,P,(10.0),R=5.0,H=1",
        "MOVEX A=1,M1J,C1,(0,0,0,0,30,0),R=5.0,H=1,MS",
        "MOVEX A=1,M1J,P,P1,R=5.0,H=1,MS",
        "MOVEX A=1,M1J,P,(0,0,0,0,30,V1!),R=5.0,H=1,MS",
        "MOVE P,P1,S=5,H=1",
        "P1 = (0,0,0,0,30,0)",
        "SHIFTR 1,10,0,0",
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, line: str) -> None:
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, program(varied(arm(), 1), line))
    assert f"line 3: {line[:60].strip()}: this is not understood" in " ".join(str(refused.value).split())


@FILES
def test_damaged_programs_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    """A position whose line is as it was is read, and corrected, as it was."""
    (tmp_path / "mine.yaml").write_text(robot_text())
    (tmp_path / "header.yaml").write_text(HEADER.replace("robot: irb1600", "robot: mine.yaml"))
    text = program(varied(arm(), 4)[[0, 0, 1, 1]])
    path = tmp_path / "MZ07-01-A.001"

    def lines(content: str) -> list[str]:
        return [line for line in content.split("\r\n") if "MOVEX" in line and "'zerobeam" not in line]

    def measured(content: str) -> list[tuple[float, ...]]:
        path.write_bytes(content.encode())
        job = ImportJob.begin([path], tmp_path / "header.yaml", tmp_path / "run.jsonl", ["a"])
        return [shot.joints_deg for shot in READER.read(job).shots]

    rows = dict(zip(lines(text), measured(text), strict=True))
    right = dict(zip(lines(text), lines(corrected(tmp_path, text)), strict=True))
    np.testing.assert_array_equal(list(rows.values()), joints(text))
    refused = 0
    for content in damaged(text, files):
        try:
            read_as, program_after = measured(content), corrected(tmp_path, content)
        except BadInput:
            refused += 1
            continue
        for before, row, after in zip(lines(content), read_as, lines(program_after), strict=True):
            assert rows.get(before, row) == row
            assert right.get(before, after) == after
    assert 0.3 * files < refused < files
