"""Zeros by the mastering before and after: what a controller's files determine, and what they do not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_backups import DIALECTS, kept, written

from zerobeam.experiments.command_options import BackupOptions, ZeroOptions
from zerobeam.experiments.converted_programs import kept_programs
from zerobeam.experiments.positions.conversion import Conversion
from zerobeam.model.errors import BadInput

MAMES = [0.0, -90.0, 90.0, 0.0, 0.0, 0.0]
CAL = [0.5, 3.25, 1.0, 6.1, 0.2, 2.0]
RATIOS = [-100.0, 100.0, 90.0, 60.0, 50.0, 40.0]
ENTERED = np.array([0.0, -0.265, 0.112, 0.0, 0.3, 0.0])  # deg


def machine_dat(mames: list[float], model: str = "#KR6R900") -> str:
    lines = [f"$MAMES[{i}]={value:.6f} ;axis {i}" for i, value in enumerate([*mames, 0.0], start=1)]
    return "\n".join(
        ["DEFDAT  $MACHINE PUBLIC", f'$TRAFONAME[]="{model}"', "REAL $MAMES[12]", *lines, "ENDDAT"]
    )


def moc(offsets: list[float]) -> str:
    rows = [
        f'      -name "rob1_{i}" -valid_com_offset \\\n      -cal_offset {value:.6f} -valid_cal_offset\n'
        for i, value in enumerate(offsets, start=1)
    ]
    return "MOC:CFG_1.0:6:0::\n#\nMOTOR_CALIB:\n\n" + "\n".join(rows) + "#\n"


def masterings(folder: Path, name: str, old: str, new: str) -> dict[str, Any]:
    paths = []
    for when, text in (("before", old), ("after", new)):
        (folder / when / "R1").mkdir(parents=True)
        paths.append(folder / when / "R1" / name)
        paths[-1].write_text(text)
    return {"old_mastering": paths[0].parents[1], "new_mastering": paths[1]}


def by_mastering(folder: Path, language: str, **zeros: Any) -> Conversion:
    dialect = DIALECTS[language]
    backup = dialect.made(3)
    path = written(backup, folder / "backup")
    answer = kept_programs(
        path,
        ZeroOptions(robot=dialect.robot, **zeros),
        BackupOptions(**backup.options),  # type: ignore[arg-type]
    )
    by_hand = kept(path, dialect.robot, ENTERED, **backup.options)
    assert answer.converted
    assert [row.after for row in answer.positions] == [
        pytest.approx(row.after, abs=1e-4) for row in by_hand.positions
    ]
    return answer


def test_mames_of_kuka(tmp_path: Path) -> None:
    new = machine_dat((np.array(MAMES) + ENTERED).tolist())
    stated = masterings(tmp_path, "$machine.dat", machine_dat(MAMES), new)
    answer = by_mastering(tmp_path, "KRL", **stated)
    assert any("right where all axes whose value changed" in note for note in answer.notes)


@pytest.mark.parametrize(
    ("new", "what"),
    [
        (machine_dat(MAMES), "is the same before and after"),
        (machine_dat([0.1, *MAMES[1:]], "#KR16"), "not of one arm"),
        (machine_dat(MAMES).replace("$MAMES[2]", "$MAMES[3]"), r"\$MAMES of the axes is not understood"),
        (machine_dat(MAMES).replace("=90.0", "=x"), r"\$MAMES of the axes is not understood"),
    ],
)
def test_what_machine_data_do_not_say_is_refused(tmp_path: Path, new: str, what: str) -> None:
    stated = masterings(tmp_path, "$machine.dat", machine_dat(MAMES), new)
    with pytest.raises(BadInput, match=what):
        by_mastering(tmp_path, "KRL", **stated)


def test_cal_offsets_of_abb(tmp_path: Path) -> None:
    """A motor that passes a whole turn, a ratio of the other direction, a sign that is stated."""
    new = np.array(CAL) - np.array(RATIOS) * np.radians(ENTERED)
    new = np.where(new > 2 * np.pi, new - 2 * np.pi, np.where(new < 0, new + 2 * np.pi, new))
    stated = masterings(tmp_path, "MOC.cfg", moc(CAL), moc(new.tolist()))
    ratio = ",".join(map(str, RATIOS))
    answer = by_mastering(tmp_path, "RAPID", **stated, motor_sign="-1", ratio=ratio)
    assert any("gears that are not coupled" in note for note in answer.notes)
    with pytest.raises(BadInput, match="does not say by how much the readings changed"):
        by_mastering(tmp_path / "no sign", "RAPID", **stated, ratio=ratio)
    with pytest.raises(BadInput, match="the gear ratio of rob1_2 is not known"):
        by_mastering(tmp_path / "no ratio", "RAPID", **stated, motor_sign="-1")


def test_of_other_makers_nothing_is_published(tmp_path: Path) -> None:
    stated = masterings(tmp_path, "ALL.PRM", "1", "2")
    with pytest.raises(BadInput, match="no published file of this maker"):
        by_mastering(tmp_path, "MELFA-BASIC", **stated)
