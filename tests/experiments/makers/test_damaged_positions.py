"""Programs that were taught, imported without a plan: a damaged position is refused by its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.positions.script import Script
from zerobeam.model.errors import BadInput

HEADER = """\
robot: {robot}
tool: {{kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, spot_mm: 0.05}}
"""
PROGRAMS = {
    "pacscript": (
        "vs060",
        "a.pcs",
        "Sub Main\n  q1 = J(1, 2, 63, 4, 5, 6)\n  {}\n  Move P, @E q1\nEnd Sub\n",
    ),
    "drl": ("m1013", "a.drl", "q1 = posj(1, 2, 63, 4, 5, 6)\nset_velj(10)\n{}\nmovej(q1)\n"),
}
DAMAGED = {
    "pacscript": [
        "q2 = J(1, 2, , 4, 5, 6)",
        "q2 = J(1, 2, 3 4, 5, 6)",
        "q2 = J(1, 2, 3O.5, 4, 5, 6)",
        "q2 = J(1, 2, 3.5.1, 4, 5, 6)",
        "q2 = J(1, 2, 63, 4, 5, 6",
        "Move P, @E J(1, 2, , 4, 5, 6)",
    ],
    "drl": [
        "q2 = posj(1, 2, , 4, 5, 6)",
        "q2 = posj(1, 2, 3 4, 5, 6)",
        "q2 = posj(1, 2, 3O.5, 4, 5, 6)",
        "q2 = posj(1, 2, 3.5.1, 4, 5, 6)",
        "q2 = posj([1, 2, 63, 4, 5, 6)",
        "movej(posj(1, 2, , 4, 5, 6))",
    ],
}
COMPUTED = {
    "pacscript": ["q2 = J(a1, 2, 3, 4, 5, 6)", "q2 = q1 + (0, 0, 1, 0, 0, 0)"],
    "drl": ["q2 = posj(a1, 2, 3, 4, 5, 6)", "q2 = posj()"],
}


def imported(folder: Path, kind: str, line: str) -> Imported:
    robot, name, program = PROGRAMS[kind]
    header, file = folder / "header.yaml", folder / name
    header.write_text(HEADER.format(robot=robot))
    file.write_text(program.format(line))
    reader = next(each for maker in makers() for each in maker.read if each.name == kind)
    return reader.read(ImportJob.begin([file], header, folder / "run.jsonl", ["psd"]))


@pytest.mark.parametrize(("kind", "line"), [(kind, line) for kind in DAMAGED for line in DAMAGED[kind]])
def test_a_damaged_position_is_refused_by_its_line(
    kind: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BadInput, match="line 3") as error:
        imported(tmp_path, kind, line)
    assert error.value.remedy
    if "bracket" not in str(error.value):  # without the check it is left out, and nobody is told
        monkeypatch.setattr(Script, "damaged", lambda *_: None)
        assert len(imported(tmp_path, kind, line).shots) == 1


@pytest.mark.parametrize(("kind", "line"), [(kind, line) for kind in COMPUTED for line in COMPUTED[kind]])
def test_a_computed_position_is_none_that_is_damaged(kind: str, line: str, tmp_path: Path) -> None:
    assert [shot.joints_deg for shot in imported(tmp_path, kind, line).shots] == [(1, 2, 63, 4, 5, 6)]
