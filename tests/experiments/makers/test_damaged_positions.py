"""Programs that were taught, imported without a plan: a damaged position is refused by its line."""

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
def test_a_computed_position_is_none_that_is_damaged_and_is_said_to_be_left_out(
    kind: str, line: str, tmp_path: Path
) -> None:
    answer = imported(tmp_path, kind, line)
    assert [shot.joints_deg for shot in answer.shots] == [(1, 2, 63, 4, 5, 6)]
    assert "  note: left out, computed when the program runs: line 3 (q2)" in answer.understood


JOINTS = "[9E9,9E9,9E9,9E9,9E9,9E9]"
LEFT_OUT = {
    "rapid": (
        "irb1600",
        "a.mod",
        f"MODULE m\nCONST jointtarget q1:=[[1,2,63,4,5,6],{JOINTS}];\nVAR jointtarget q2;\nPROC main()\n"
        f"q2:=CalcJointT(p,tool0);\nMoveAbsJ [[0,0,0,0,30,0],{JOINTS}],v,fine,tool0;\nENDPROC\nENDMODULE\n",
        ["computed when the program runs: line 5 (q2)", "in motions, without names: line 6"],
    ),
    "krl": (
        "kr6_r900",
        "a.src",
        "DEF a()\nDECL AXIS Q1={A1 1,A2 2,A3 63,A4 4,A5 5,A6 6}\n"
        "PTP {A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}\nEND\n",
        ["in motions, without names: line 3"],
    ),
    "as": (
        "rs007n",
        "a.as",
        ".PROGRAM a()\n  HERE #q2\n  JMOVE #q[n]\n.END\n.JOINTS\n#q1 1 2 63 4 5 6\n.END\n",
        ["computed when the program runs: line 2 (#q2), line 3"],
    ),
    "tmscript": (
        "tm5_900",
        "a.tms",
        "float[] q1 = {1, 2, 63, 4, 5, 6}\n"
        'float[] q2 = {q1[0] + 5, 2, 63, 4, 5, 6}\nPTP("JPP",q1,9,9,0,false)\n',
        ["computed when the program runs: line 2 (q2)"],
    ),
}


@pytest.mark.parametrize("kind", LEFT_OUT)
def test_nothing_is_left_out_without_a_word(kind: str, tmp_path: Path) -> None:
    robot, name, program, sentences = LEFT_OUT[kind]
    (tmp_path / "header.yaml").write_text(HEADER.format(robot=robot))
    (tmp_path / name).write_text(program)
    reader = next(each for maker in makers() for each in maker.read if each.name == kind)
    job = ImportJob.begin([tmp_path / name], tmp_path / "header.yaml", tmp_path / "run.jsonl", ["psd"])
    answer = reader.read(job)
    assert [shot.joints_deg for shot in answer.shots] == [(1, 2, 63, 4, 5, 6)]
    notes = [line for line in answer.understood if "left out" in line]
    assert notes == [f"  note: left out, {sentence}" for sentence in sentences]
    # Who names the points has chosen.
    first = next(line for line in answer.understood if "in their order" in line).rpartition(" ")[2]
    chosen = reader.read(job, points=[first])
    assert not any("left out" in line for line in chosen.understood)
    if "(q2)" in sentences[0]:
        with pytest.raises(
            BadInput, match=r"(?s)point q2 has no joint values.*computed when the program runs"
        ):
            reader.read(job, points=["q2"])
