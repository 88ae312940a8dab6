"""What is refused, by line, and that without the check a wrong place would be written."""

import dataclasses
import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_runs import arm_run
from made_backups import DIALECTS, ENTERED, MadeBackup, MadePosition, kept, texts_after, written
from scipy.spatial.transform import Rotation

from zerobeam.experiments.command_options import BackupOptions, ReachOptions, ZeroOptions
from zerobeam.experiments.converted_programs import kept_programs, reached_programs, restored, shown_programs
from zerobeam.experiments.makers.calibration import calibration
from zerobeam.experiments.makers.generic.robot_files import robot_text
from zerobeam.experiments.positions import arm_change, position
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import write_run
from zerobeam.reports.positions_page import write_conversion

RAPID, KRL, TP = DIALECTS["RAPID"], DIALECTS["KRL"], DIALECTS["TP"]
UNUSED = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def module(*lines: str, data: str = "") -> str:
    return "\n".join(["MODULE M", data, "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""])


def robtarget(joints: list[float], name: str = "p1", external: str = UNUSED) -> str:
    """A declaration of where the IRB 120 is, with its own configuration."""
    row = np.array(joints, dtype=float)
    pose = RAPID.arm.fk(row, "deg")
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    place = ",".join(f"{each:.6f}" for each in pose[:3, 3])
    configuration = ",".join(map(str, RAPID._confdata(row)))  # type: ignore[attr-defined]
    return (
        f"CONST robtarget {name}:=[[{place}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],[{configuration}],{external}];"
    )


def one_file(folder: Path, text: str, name: str = "M.mod") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text, encoding="latin-1")
    return folder


GOOD = [10.0, 20.0, 15.0, 30.0, 40.0, 50.0]
MOVE = "  MoveJ p1,v100,fine,tool0;"


def refusals(folder: Path, robot: str = "irb120", **choices: object) -> list[str]:
    answer = kept(folder, robot, **choices)
    assert not answer.converted or not answer.refused
    return [f"{one.line}: {one.sentence}" for one in answer.refused]


# Line 2 of the module is its data, line 4 its motion.
REFUSED = {
    "overwritten": (["  p1.trans.z:=10;", MOVE], robtarget(GOOD), "4: the program overwrites"),
    "several tools": (
        [MOVE, "  MoveJ p1,v100,fine,t2;"],
        "PERS tooldata t2:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];" + robtarget(GOOD),
        "2: p1 is used with several tools: t2, tool0",
    ),
    "tool at run time": (
        ["  t2.tframe.trans.z:=9;", "  MoveJ p1,v100,fine,t2;"],
        "PERS tooldata t2:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];" + robtarget(GOOD),
        "4: t2 is set when the program runs",
    ),
    "remote TCP": (
        ["  MoveJ p1,v100,fine,t2;"],
        "PERS tooldata t2:=[FALSE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];" + robtarget(GOOD),
        "2: p1: its tool t2: t2 is a stationary tool",
    ),
    "moved frame": (
        ["  MoveJ p1,v100,fine,tool0\\WObj:=w;"],
        'PERS wobjdata w:=[FALSE,FALSE,"STN1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];' + robtarget(GOOD),
        "2: p1: its frame w: w is moved by an external unit",
    ),
    "external axes": (
        [MOVE],
        robtarget(GOOD, external="[100,9E9,9E9,9E9,9E9,9E9]"),
        "2: p1 has positions of",
    ),
    "displacement": (["  PDispOn p1,tool0;", MOVE], robtarget(GOOD), "4: PDispOn moves all targets"),
    "joint 5 near zero": ([MOVE], robtarget([10, 20, 15, 30, 0.3, 50]), "2: p1: joint 5 is at"),
    "twice the change of joint 5": (
        [MOVE],
        robtarget([10, 20, 15, 30, -0.41, 50]),
        "2: p1: joint 5 is at",
    ),
    "limit": ([MOVE], robtarget([164.95, 20, 15, 30, 40, 50]), "2: p1: once converted joint 1 is at 165.063"),
    "declared twice": (
        [MOVE],
        robtarget(GOOD) + robtarget([11.0, 20, 15, 30, 40, 50]),
        "2: p1 is declared twice",
    ),
    "no such configuration": (
        [MOVE],
        robtarget(GOOD).replace("[0,0,0,0]", "[0,0,0,7]"),
        "2: p1: joints reach it, but none with the stated configuration (0, 0, 0, 7): found are 0, 0, 0, 0"
        " (joints 10.0, 20.0, 15.0, 30.0, 40.0, 50.0); ",
    ),
    "damaged": ([MOVE], robtarget(GOOD).replace("],[", "],", 1), "2: the numbers of p1 are not understood"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_it_is_refused_by_line(case: str, tmp_path: Path) -> None:
    lines, data, sentence = REFUSED[case]
    found = refusals(one_file(tmp_path / "b", module(*lines, data=data)))
    assert any(each.startswith(sentence) for each in found), found
    assert refusals(one_file(tmp_path / "good", module(MOVE, data=robtarget(GOOD)))) == []


def as_saved(joints: list[float]) -> str:
    """A declaration as a controller saves it: two decimals of a millimetre, six of a quaternion."""
    exact = robtarget(joints)
    numbers = [float(each) for each in re.findall(r"-?\d+\.\d+", exact)]
    place = ",".join(f"{each:.2f}" for each in numbers[:3])
    turn = ",".join(f"{each:.6f}" for each in numbers[3:7])
    return f"CONST robtarget p1:=[[{place}],[{turn}]{exact[exact.index(',[', exact.index('],[') + 2) :]}"


def off_by(joints: list[float], folder: Path) -> float:
    """mm by which a tool of 200 mm is off where an arm was taught with these joints, once converted."""
    row, entered = np.array(joints), np.array([0, 0, 0, 0, 0.211, 0])
    answer = kept(one_file(folder, module(MOVE, data=as_saved(joints))), "irb120", entered)
    assert answer.converted
    numbers, configuration = RAPID.found(_made("p1", row), {"M.mod": answer.content["M.mod"].decode()})
    (reading,) = RAPID.arm.climbed(RAPID.matrix(numbers), row + entered)
    assert RAPID.agrees(configuration, reading)
    tip = np.array([0.0, 0, 200, 1])
    meant, there = (RAPID.arm.fk(each, "deg") @ tip for each in (row + entered, reading))
    return float(np.linalg.norm(meant - there))


def test_without_the_check_of_joint_5_a_wrong_place_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pose that a controller has saved, rounded, has other joints 4 and 6: joint 5 is then turned about
    another axis. With joint 5 well bent the same rounding leaves nothing of it."""
    near = [10.0, 20.0, 15.0, 30.0, 0.002, 50.0]
    assert any(
        "joint 5 is at" in one
        for one in refusals(one_file(tmp_path / "b", module(MOVE, data=as_saved(near))))
    )
    monkeypatch.setattr(arm_change.ArmChange, "_require_regular", lambda self, before, after: None)
    assert off_by(near, tmp_path / "near") > 0.1
    assert off_by(GOOD, tmp_path / "good") < 0.01


def _made(name: str, joints: np.ndarray) -> MadePosition:
    return MadePosition(name, joints, "tool0", "wobj0", False)


def test_without_the_check_of_tools_another_place_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines, data, _ = REFUSED["several tools"]
    monkeypatch.setattr(position.BackupReading, "_with_frames", _first_tool)
    answer = kept(one_file(tmp_path / "b", module(*lines, data=data)), "irb120")
    assert answer.converted
    numbers, _ = RAPID.found(_made("p1", np.array(GOOD)), {"M.mod": answer.content["M.mod"].decode()})
    other_tool = np.eye(4)
    other_tool[2, 3] = 9.0
    places = []
    for tool in (np.eye(4), other_tool):
        before = RAPID.arm.climbed(RAPID.arm.fk(np.array(GOOD), "deg") @ np.linalg.inv(tool), np.array(GOOD))[
            0
        ]
        after = RAPID.arm.climbed(RAPID.matrix(numbers) @ np.linalg.inv(tool), np.array(GOOD))[0]
        meant, reached = (RAPID.arm.fk(each, "deg") @ tool for each in (before + ENTERED, after))
        places.append(float(np.linalg.norm(meant[:3, 3] - reached[:3, 3])))
    assert max(places) > 0.01 > min(places)


def _first_tool(reading: Any, one: Any, uses: Any) -> Any:
    return dataclasses.replace(one, tool="tool0", frame="wobj0")


def test_a_second_conversion_is_refused_and_would_move_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backup = RAPID.made(3)
    answer = kept(written(backup, tmp_path / "backup"), "irb120")
    write_conversion(tmp_path / "new", answer)
    again = tmp_path / "again" / "TASK1"
    again.mkdir(parents=True)
    (again / "Work.mod").write_bytes(answer.content["TASK1/Work.mod"])
    for path in (tmp_path / "new", tmp_path / "again"):
        with pytest.raises(BadInput, match="converted before"):
            kept(path, "irb120")
    # Saved anew by the controller: other bytes, the same positions.
    (again / "Work.mod").write_bytes(answer.content["TASK1/Work.mod"].replace(b"VERSION:1", b"VERSION:2 "))
    with pytest.raises(BadInput, match="converted before"):
        kept(tmp_path / "again", "irb120")
    monkeypatch.setattr("zerobeam.experiments.converted_programs.require_not_converted", lambda *_: None)
    twice = kept(tmp_path / "again", "irb120")
    assert backup.kept(texts_after(backup, answer), ENTERED)
    assert not backup.kept({name: content.decode() for name, content in twice.content.items()}, ENTERED)


def test_a_changed_file_is_not_restored(tmp_path: Path) -> None:
    backup = TP.made(2)
    write_conversion(tmp_path / "new", kept(written(backup, tmp_path / "backup"), TP.robot))
    name = "WORK.LS"
    (tmp_path / "new" / name).write_bytes((tmp_path / "new" / name).read_bytes() + b" ")
    with pytest.raises(BadInput, match="changed after the conversion"):
        restored(tmp_path / "new")


def test_an_audit_restores_by_its_path_too(tmp_path: Path) -> None:
    backup = TP.made(2)
    write_conversion(tmp_path / "new", kept(written(backup, tmp_path / "backup"), TP.robot))
    assert restored(tmp_path / "new" / "audit.json") == restored(tmp_path / "new")


def _converted(folder: Path) -> Path:
    write_conversion(folder / "new", kept(written(TP.made(2), folder / "backup"), TP.robot))
    return folder / "new"


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def _beside_a_cut_audit(folder: Path) -> None:
    _cut(_converted(folder) / "audit.json")
    kept(folder / "backup", TP.robot)


def _of_a_cut_audit(folder: Path) -> None:
    _cut(_converted(folder) / "audit.json")
    restored(folder / "new")


def _of_a_lost_file(folder: Path) -> None:
    (_converted(folder) / "WORK.LS").unlink()
    restored(folder / "new")


def _of_bad_archive(folder: Path) -> None:
    (folder / "bad.zip").write_text("no archive")
    shown_programs(folder / "bad.zip")


def _of_nothing(folder: Path) -> None:
    (folder / "empty").mkdir()
    shown_programs(folder / "empty")


TO_DO: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "missing": (lambda folder: shown_programs(folder / "no"), "no such file or folder", "zip of a backup"),
    "empty": (_of_nothing, "nothing in it that is read here", "save the programs at the controller"),
    "archive": (_of_bad_archive, "archive cannot be read", "make the archive again"),
    "restore nothing": (lambda folder: restored(folder / "no"), "no conversion here", "name that folder"),
    "restore a backup": (restored, "no conversion here", "name that folder"),
    "restore by a cut audit": (_of_a_cut_audit, "no audit of a conversion", "copy it again"),
    "restore a lost file": (_of_a_lost_file, "or is missing", "the backup that was converted"),
    "beside a cut audit": (_beside_a_cut_audit, "no audit of a conversion", "Move it elsewhere only if"),
}


@pytest.mark.parametrize("case", TO_DO)
def test_what_cannot_be_read_says_what_to_do(tmp_path: Path, case: str) -> None:
    called, what, remedy = TO_DO[case]
    with pytest.raises(BadInput, match=what) as error:
        called(tmp_path)
    assert remedy in str(error.value.remedy)


def test_the_backup_of_another_model_is_refused(tmp_path: Path) -> None:
    backup = TP.made(4)
    line = "     Field: $SCR_GRP[1].$ROBOT_ID Access: RO: STRING[21] = '{}'\n"
    backup.texts["SYSMOTN.VA"] = "[*SYSTEM*]$SCR_GRP  Storage: CMOS\n" + line.format("LR Mate 200iD")
    assert kept(written(backup, tmp_path / "own"), TP.robot).converted
    backup.texts["SYSMOTN.VA"] = "[*SYSTEM*]$SCR_GRP  Storage: CMOS\n" + line.format("R-2000iC/165F")
    with pytest.raises(BadInput, match="another model"):
        kept(written(backup, tmp_path / "other"), TP.robot)


def test_another_makers_backup_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="robots of KUKA"):
        kept(written(KRL.made(1), tmp_path), "irb120")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("language", DIALECTS)
def test_nothing_is_written_in_part(language: str, tmp_path: Path) -> None:
    backup: MadeBackup = DIALECTS[language].made(7)
    endings = ("mod", "src", "ls", "jbi", "as", "prg", "pgx", "drl", "pcs", "script")
    name = next(name for name in backup.texts if name.lower().endswith(endings))
    bad = {
        "RAPID": (
            "ENDPROC",
            "  MoveL [[1,2,3],[1,0,0,0],[0,0,0,0]," + UNUSED + "],v1,fine,tool9;\r\nENDPROC",
        ),
        "KRL": ("END\r\n", "PTP XP99\r\nLIN {X 1,Y 2,Z 3,A 4,B 5,C 6}\r\nEND\r\n"),
        "TP": ("/POS", "  99:L P[99] 100mm/sec FINE INC    ;\n/POS"),
        "AS": ("  DELAY 1", "  JMOVE #nowhere\r\n  DELAY 1"),
        "SPEL+": ("Fend", "  Go P99\r\nFend"),
        "MELFA-BASIC": ("Dly 0.5", "Mov P99"),
        "INFORM": ("NOP\r\n", "NOP\r\nMOVL C00099 V=10.0\r\n"),
        "VAL3": ("  waitEndMove()", "  movej(pNone,flange,mNom)\r\n  waitEndMove()"),
        "DRL": ("wait(0.5)", "movej(Global_home)\r\nwait(0.5)"),
        "PacScript": ("  GiveArm", "  Move P, P[99]\r\n  GiveArm"),
        "URScript": ("end\r\n", "  movej(home_q)\r\nend\r\n"),
    }[language]
    backup.texts[name] = backup.texts[name].replace(*bad)
    answer = kept(written(backup, tmp_path), DIALECTS[language].robot, **backup.options)
    assert not answer.converted
    assert answer.content == {}
    assert answer.refused or answer.to_state or answer.open_lines


def test_lines_are_accepted_by_name(tmp_path: Path) -> None:
    folder = one_file(
        tmp_path,
        module(
            "  MoveL Offs(p1,0,0,100),v1,fine,tool0;",
            "  MoveL CRobT(),v1,fine,tool0;",
            MOVE,
            data=robtarget(GOOD),
        ),
    )
    answer = kept(folder, "irb120")
    assert [(one.line, one.kind, one.accepted) for one in answer.listed] == [
        (4, "relative", False),
        (5, "computed", False),
    ]
    assert not answer.converted
    assert not kept(folder, "irb120", accept=["M.mod:4"]).converted
    assert kept(folder, "irb120", accept=["M.mod:4,M.mod:5"]).converted
    assert kept(folder, "irb120", accept=["M.mod:4-5"]).converted
    with pytest.raises(BadInput, match="--accept"):
        kept(folder, "irb120", accept=["M.mod"])
    for nothing in ("M.mod:11", "N.mod:4"):  # it was ignored without a word
        with pytest.raises(BadInput, match="names no line that is to be looked at") as caught:
            kept(folder, "irb120", accept=["M.mod:4-5", nothing])
        assert (caught.value.found, caught.value.allowed) == (nothing, "M.mod:4, M.mod:5")


def test_a_configuration_that_is_written_otherwise_is_named(tmp_path: Path) -> None:
    """[0,0,0,0] became [0,-1,0,0] without a word."""
    row = [*GOOD[:3], 0.1, *GOOD[4:]]
    answer = kept(
        one_file(tmp_path, module(MOVE, data=robtarget(row))), "irb120", np.array([0, 0, 0, -0.5, 0, 0])
    )
    assert answer.converted
    (note,) = [note for note in answer.notes if "written otherwise" in note]
    assert "M.mod:2 0, 0, 0, 0 to 0, -1, 0, 0" in note
    other = kept(
        one_file(tmp_path, module(MOVE, data=robtarget(GOOD))), "irb120", np.array([0, 0, 0, -0.5, 0, 0])
    )
    assert not any("written otherwise" in note for note in other.notes)


def test_the_shift_of_a_relative_move_is_that_of_an_arm_that_runs_it(tmp_path: Path) -> None:
    row, step = np.array(GOOD), np.eye(4)
    step[2, 3] = 100.0
    folder = one_file(tmp_path, module("  MoveL Offs(p1,0,0,100),v1,fine,tool0;", MOVE, data=robtarget(GOOD)))
    answer = kept(folder, "irb120", accept=["M.mod:4"])
    (line,) = answer.listed
    numbers, _ = RAPID.found(_made("p1", row), {"M.mod": answer.content["M.mod"].decode()})
    before = RAPID.arm.climbed(step @ RAPID.arm.fk(row, "deg"), row)[0] + ENTERED
    after = RAPID.arm.climbed(step @ RAPID.matrix(numbers), row + ENTERED)[0]
    shift = np.linalg.norm(RAPID.arm.fk(before, "deg")[:3, 3] - RAPID.arm.fk(after, "deg")[:3, 3])
    assert line.shift_mm is not None
    assert not line.per_100_mm
    assert line.shift_mm >= 0.999 * shift > 0.1
    unknown = one_file(tmp_path / "u", module("  MoveL Offs(p1,0,0,nZ),v1,fine,tool0;", data=robtarget(GOOD)))
    (line,) = kept(unknown, "irb120").listed
    assert line.per_100_mm


def test_new_tools_and_frames_are_taken(tmp_path: Path) -> None:
    tool = "PERS tooldata t:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
    folder = one_file(tmp_path, module("  MoveJ p1,v100,fine,t;", data=tool + robtarget(GOOD)))
    answer = kept(folder, "irb120", new_tools=["t=1,0,101,1,0,0,0"], new_frames=["wobj0=0,0,5,1,0,0,0"])
    numbers, _ = RAPID.found(_made("p1", np.array(GOOD)), {"M.mod": answer.content["M.mod"].decode()})
    old, new, frame = np.eye(4), np.eye(4), np.eye(4)
    old[2, 3], new[:3, 3], frame[2, 3] = 100.0, (1, 0, 101), 5.0
    joints = RAPID.arm.climbed(RAPID.arm.fk(np.array(GOOD), "deg") @ np.linalg.inv(old), np.array(GOOD))[0]
    meant = RAPID.arm.fk(joints + ENTERED, "deg")
    reached = frame @ RAPID.matrix(numbers) @ np.linalg.inv(new)
    assert np.abs(meant - reached).max() < 1e-4


def test_a_corrected_arm_is_not_what_a_controller_computes_with(tmp_path: Path) -> None:
    """A robot file that `export robot` has written moves other joints to a pose."""
    run = arm_run(tmp_path)
    corrected = tmp_path / "corrected.yaml"
    corrected.write_text(robot_text(run, calibration(run, holds="links")), encoding="utf-8")
    backup = one_file(tmp_path / "b", module(MOVE, data=robtarget(GOOD)))
    zeros = "J2=0.1"
    with pytest.raises(BadInput, match="is a corrected arm"):
        kept_programs(backup, ZeroOptions(robot=str(corrected), entered=(zeros,)), BackupOptions())
    of_corrected = tmp_path / "of_corrected.jsonl"
    write_run(of_corrected, run.header.model_copy(update={"robot": corrected.name}), run.shots)
    with pytest.raises(BadInput, match="is a corrected arm"):
        kept_programs(backup, ZeroOptions(run=of_corrected), BackupOptions())
    with pytest.raises(BadInput, match="is a corrected arm"):
        reached_programs(backup, of_corrected, BackupOptions(), ReachOptions())
    assert kept_programs(backup, ZeroOptions(robot="irb120", entered=(zeros,)), BackupOptions()).converted


def test_zeros_are_understood_or_refused(tmp_path: Path) -> None:
    folder = one_file(tmp_path, module(MOVE, data=robtarget(GOOD)))
    for text in ("J7=0.1", "J2", "J2=0.1,J2=0.2", "J2=0", "J2=9", "0.1"):
        with pytest.raises(BadInput):
            kept_programs(folder, ZeroOptions(robot="irb120", entered=(text,)), BackupOptions())
    for zeros in (ZeroOptions(), ZeroOptions(entered=("J2=0.1",)), ZeroOptions(robot="irb120")):
        with pytest.raises(BadInput):
            kept_programs(folder, zeros, BackupOptions())


def test_what_a_backup_leaves_open_is_asked_once(tmp_path: Path) -> None:
    data = robtarget(GOOD) + robtarget([12.0, 20, 15, 30, 40, 50], "p2")
    folder = one_file(tmp_path, module("  MoveJ p1,v1,fine,tX;", "  MoveJ p2,v1,fine,tX;", data=data))
    assert kept(folder, "irb120").to_state == ("--tool tx=X,Y,Z,Q1,Q2,Q3,Q4",)
    assert kept(folder, "irb120", tools=["tX=0,0,100,1,0,0,0"]).converted
    assert kept(folder, "irb120", tools=["0,0,100,1,0,0,0"]).converted


def test_the_sha_of_an_audit_is_that_of_the_files(tmp_path: Path) -> None:
    backup = KRL.made(5)
    answer = kept(written(backup, tmp_path), KRL.robot)
    for one in answer.files:
        assert one.sha256 == hashlib.sha256(backup.texts[one.file].encode("latin-1")).hexdigest()
        assert one.new_sha256 == hashlib.sha256(answer.content[one.file]).hexdigest()
    assert load_robot(KRL.robot).name == answer.robot


def test_zeros_that_are_stated_apart_are_all_entered(tmp_path: Path) -> None:
    """And the pendant's own count of joint 3 is said, where it goes with joint 2."""
    folder = written(TP.made(3), tmp_path / "tp")
    apart, together = (
        kept_programs(folder, ZeroOptions(robot=TP.robot, entered=entered), BackupOptions())
        for entered in (("J2=-0.2", "J3=0.1"), ("J2=-0.2,J3=0.1",))
    )
    assert apart.entered == together.entered
    assert len(apart.entered) == 2
    assert any("at the same place it shows J3 +0.3000" in note for note in apart.notes)


def test_a_backup_with_files_of_another_language_is_refused(tmp_path: Path) -> None:
    """They would stay as they are beside those that were converted."""
    folder = written(RAPID.made(3), tmp_path / "mixed")
    written(TP.made(3), folder)
    with pytest.raises(BadInput, match="files of another language"):
        kept_programs(folder, ZeroOptions(robot=RAPID.robot, entered=("J2=0.1",)), BackupOptions())


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("work.mod", "MODULE work\nCONST jointtarget p1:=[[0,-20,10,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"),
        ("work.src", "DEF work()\nPTP {A1 0,A2 -20,A3 10,A4 0,A5 30,A6 0}\n"),
        ("work.script", "def work():\n  movej([0,-1.2,1.1,0.3,0.4,0.5])\n"),
    ],
)
def test_a_file_that_was_cut_off_is_refused(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    (line,) = shown_programs(path).refused
    assert "not whole" in line.sentence
    ends = {"mod": "ENDMODULE\n", "src": "END\n", "script": "end\n"}
    path.write_text(text + ends[name.rpartition(".")[2]])  # the control
    assert shown_programs(path).refused == ()
