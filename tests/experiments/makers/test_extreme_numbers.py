"""Numbers that no float holds, or that are useless, in every format that is imported: one message."""

import random
import re
import shlex
from pathlib import Path

import pytest
from fuzzing import Damaged, judged
from recorded_logs import (
    HEADER,
    POSTURES,
    fanuc_listing,
    fanuc_position,
    kuka_list,
    kuka_point,
    table,
)

from zerobeam.experiments.makers.contents import contents_of
from zerobeam.model import kernel
from zerobeam.model.errors import BadInput

pytestmark = pytest.mark.filterwarnings("default", "ignore::zerobeam.model.kernel.KernelWarning")

EXTREME = ("1e400", "-1E+400", "9" * 400, "1" * 5000, "1e308", "1e200", "9" * 30, "1e99999999999")
ROWS = POSTURES.tolist()
UNUSED = ",".join(["9E9"] * 6)
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
HEADED = "--target a --header header.yaml -o made"


def _lines(text: str) -> str:
    """The line for each row: `text` with its number and its values."""
    return "".join(text.format(i=i, row=row, listed=",".join(map(str, row))) for i, row in enumerate(ROWS, 1))


def _joint_states(row: list[float]) -> str:
    names = "".join(f"- joint{i}\n" for i in range(1, 7))
    return f"---\nname:\n{names}position:\n" + "".join(f"- {value / 60:.5f}\n" for value in row)


FORMATS = {
    f"import rapid points.mod {HEADED}": _lines("CONST jointtarget p{i}:=[[{listed}],[" + UNUSED + "]];\n"),
    f"import rapid poses.mod --tool 0,0,100,1,0,0,0 {HEADED}": "CONST robtarget p1:=[[900,0,900],"
    f"[0.5,0,0.8660254,0],[0,0,0,0],[{UNUSED}]];\n",
    f"import krl points.dat {HEADED}": kuka_list(
        "".join(kuka_point(f"P{i}", row) for i, row in enumerate(ROWS))
    ),
    f"import fanuc points.ls --j3 link {HEADED}": fanuc_listing(
        "".join(fanuc_position(i, row) for i, row in enumerate(ROWS, 1))
    ),
    f"import fanuc posreg.va --j3 link {HEADED}": "[*POSREG*]$POSREG  Storage: CMOS\n"
    + _lines(
        "     [1,{i}] =   'a'   Group: 1\n  J1 = {row[0]} deg  J2 = {row[1]} deg  J3 = {row[2]} deg\n"
        "  J4 = {row[3]} deg  J5 = {row[4]} deg  J6 = {row[5]} deg\n"
    ),
    f"import universal-robots points.log {HEADED}": _lines("zerobeam posture {i} deg {listed}\n"),
    f"import ros points.yaml {HEADED}": "".join(map(_joint_states, ROWS)),
    f"import csv points.csv --units deg {HEADED}": table(None, ROWS, ","),
    "import ur-calibration calibration.conf --robot ur5e -o made.yaml": "".join(
        f"delta_{name} = [1e-5, 1e-5, -1e-5, 1e-5, 1e-5, 0]\n" for name in ("theta", "a", "d", "alpha")
    ),
    "import ur-calibration calibration.yaml --robot ur5e -o made.yaml": "kinematics:\n"
    + "".join(f"  {link}: {{x: 0.1, y: 0.2, z: 0.1, roll: 0, pitch: 0.1, yaw: 3.1}}\n" for link in LINKS),
}


def _tried(command: str, count: int, folder: Path) -> list[tuple[str, list[str]]]:
    """What is wrong with the answers where one number of the file is another; `count` of them."""
    chance, text = random.Random(27), FORMATS[command]
    numbers = list(re.finditer(r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?", text, re.IGNORECASE))
    file = next(word for word in command.split() if "." in word)
    wrong = []
    for i in range(count):
        at, extreme = chance.choice(numbers), chance.choice(EXTREME)
        changed = text[: at.start()] + extreme + text[at.end() :]
        place = folder / str(i)
        place.mkdir()
        files = {file: changed.encode(), "header.yaml": HEADER.encode()}
        answer, faults = judged(Damaged(tuple(shlex.split(command)), files, ""), place)
        made = place / "made"
        if made.exists() and re.search(r"\b(inf|nan)\b", made.read_text(), re.IGNORECASE):
            faults = [*faults, "what was written is not finite"]
        if faults:
            wrong.append(
                (f"{text[max(at.start() - 40, 0) : at.start()]}{extreme[:20]}", [*faults, answer.err])
            )
    return wrong


@pytest.fixture(autouse=True)
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "_compiler", lambda: None)


@pytest.mark.parametrize("command", FORMATS)
@pytest.mark.one_in(4)
def test_an_extreme_number_is_one_message(command: str, tmp_path: Path) -> None:
    assert _tried(command, 12, tmp_path) == []


@pytest.mark.long
@pytest.mark.parametrize("command", FORMATS)
def test_hundreds_of_extreme_numbers_are_one_message_each(command: str, tmp_path: Path) -> None:
    assert _tried(command, 300, tmp_path) == []


def test_a_long_file_of_empty_lines_is_no_endless_search(tmp_path: Path) -> None:
    """It was quadratic: hours, for what an upload may hold."""
    path = tmp_path / "empty.dat"
    path.write_text("DEF\n" + "\n" * 200_000)
    with pytest.raises(BadInput):
        contents_of(path)
