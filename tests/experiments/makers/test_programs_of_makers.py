"""Programs of plans as controllers of each maker save them: read back, damaged, refused."""

from __future__ import annotations

from pathlib import Path

import denso_controller
import doosan_controller
import epson_controller
import kawasaki_controller
import mitsubishi_controller
import nachi_controller
import numpy as np
import pytest
import staubli_controller
import techman_controller
import yaskawa_controller
from cells import good_plan
from damaged_files import joints_read, lines_of, recorded, refused
from import_files import positions_of
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput

COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])


@pytest.mark.parametrize("stopped", ["zb_p0", "zb_p1"])
def test_a_start_that_was_stopped_on_the_way_goes_there_again(tmp_path: Path, stopped: str) -> None:
    plan = plan_for(tmp_path, "vs060", denso_controller.TARGET, count=3)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    run = denso_controller.PacScriptController((tmp_path / "zb_plan.pcs").read_text(), PendantArm(plan))
    for _ in range(2):
        run.stops_before = stopped
        run.start()
        run.stops_before = ""
    run.start()
    assert [line for line in run.window if "posture" in line][1:] == []
    np.testing.assert_allclose(np.array(run.arm.moves)[-1], np.degrees(plan.postures)[int(stopped[-1])])


def test_a_name_that_is_none_of_a_program_is_refused(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "vs060", denso_controller.TARGET, count=1)
    with pytest.raises(BadInput, match="PacScript does not allow this one"):
        write_program("pacscript", plan, ProgramMotion(), tmp_path / "1st.pcs")


@COUNTS
def test_damaged_logs(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "vs060", denso_controller.TARGET, count=4)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    log = denso_controller.carried_out(tmp_path / "zb_plan.pcs", PendantArm(plan))
    text = log.read_text()
    lines = {int(line.split()[3]): line for line in text.splitlines() if " posture " in line}
    assert 0.1 * count < refused(joints_read("pacscript", plan, log), text, lines, count) < count


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "vs060", denso_controller.TARGET, count=4)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    text = recorded((tmp_path / "zb_plan.pcs").read_text(), r"zb_p\d+ = J\([-.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"zb_p(\d+) = J").items()}
    read_joints = joints_read("pacscript", plan, tmp_path / "saved.pcs")
    assert count / 10 < refused(read_joints, text, lines, count) < count


@pytest.mark.parametrize("reader", ["program", "log"])
@COUNTS
def test_damaged_recordings_of_drl(tmp_path: Path, reader: str, count: int) -> None:
    plan = plan_for(tmp_path, "m1013", doosan_controller.TARGET, count=5)
    rows = np.degrees(plan.postures) + 0.123456
    if reader == "program":
        lines = {i: f"zb_p{i} = posj({', '.join(f'{v:.6f}' for v in row)})\n" for i, row in enumerate(rows)}
        text = "# zerobeam plan\n" + "".join(f"{line}movej(zb_p{i})\n" for i, line in lines.items())
    else:
        values = [" ".join(f"{v:.6f}" for v in row) for row in rows]
        lines = {i: f"zerobeam posture {i} deg {row}\n" for i, row in enumerate(values)}
        text = "".join(f"10:00:0{i}  {line}" for i, line in lines.items())
    read_joints = joints_read("drl", plan, tmp_path / "recorded.drl")
    assert refused(read_joints, text, lines, count) < 0.9 * count


FILES = pytest.mark.parametrize("files", [10, pytest.param(200, marks=pytest.mark.long)])


@FILES
def test_damaged_logs_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, epson_controller.robot_file(tmp_path), epson_controller.TARGET, count=4)
    write_program("spel", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    log = epson_controller.carried_out(tmp_path / "zb_plan.prg", PendantArm(plan))
    text = log.read_text()
    lines = {int(line.split()[2]): line for line in text.splitlines() if " posture " in line}
    assert len(lines) == 4
    assert 0.1 * files < refused(joints_read("spel", plan, log), text, lines, files) < files


def test_a_posture_that_is_not_centred_is_gone_to_again(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, epson_controller.robot_file(tmp_path), epson_controller.TARGET, count=3)
    write_program("spel", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    run = epson_controller.SpelController((tmp_path / "zb_plan.prg").read_text(), PendantArm(plan))
    for answer, following in ((1, 1), (0, 1), (1, 2)):
        run.answer = answer
        run.start()
        assert run.variables["zb_next"] == following
    moves = np.array(run.arm.moves)
    np.testing.assert_allclose(moves, np.degrees(plan.postures)[[0, 0, 1]], atol=1e-9)
    assert run.log.count("zerobeam posture") == 1


TARGET = (450.0, 0.0, 0.0)


def test_the_list_has_the_postures_in_radians(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=3)
    path = tmp_path / "zb_plan.py"
    write_program("franka", plan, ProgramMotion(), path)
    names: dict[str, list[float]] = {}
    exec(path.read_text(), {}, names)
    np.testing.assert_allclose([names[f"zb_p{i}"] for i in range(3)], plan.postures, atol=1e-11)
    with pytest.raises(BadInput, match="no measurements found"):  # nothing was recorded yet
        joints_read("franka", plan, path)(path.read_text())


def test_the_arm_of_another_maker_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="a joint list of libfranka is for robots of Franka"):
        write_program("franka", good_plan(3), ProgramMotion(), tmp_path / "zb_plan.py")


def test_degrees_are_refused(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=1)
    text = f"zb_m0 = {np.degrees(plan.postures[0] + 0.002).tolist()}\n"
    with pytest.raises(BadInput, match="is not at the plan's posture"):
        joints_read("franka", plan, tmp_path / "recorded.py")(text)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_recordings_of_joint_list(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "panda", TARGET, count=5)
    rows = [", ".join(f"{value:.9f}" for value in row) for row in plan.postures + 0.002]
    lines = {i: f"zb_m{i} = [{row}]\n" for i, row in enumerate(rows)}
    read_joints = joints_read("franka", plan, tmp_path / "recorded.py")
    assert refused(read_joints, "# recorded\n" + "".join(lines.values()), lines, count) < 0.9 * count


@COUNTS
def test_damaged_recordings_of_as(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "rs007n", kawasaki_controller.TARGET, count=5)
    rows = [" ".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"#zb_m{i} {row}\n" for i, row in enumerate(rows)}
    text = ".JOINTS\n" + "".join(lines.values()) + ".END\n"
    read_joints = joints_read("as", plan, tmp_path / "saved.as")
    assert refused(read_joints, text, lines, count) < count


def test_a_line_of_digits_is_no_endless_search() -> None:
    with pytest.raises(BadInput, match="not understood"):
        positions_of("as", f".JOINTS\n#a {'1' * 400}x\n.END\n", Path("a.as"))


@pytest.mark.long
def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "rv2fr", mitsubishi_controller.TARGET, 4)
    write_program("melfa", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    text = recorded((tmp_path / "zb_plan.prg").read_text(), r"JZB_P\d+=\([-+.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"JZB_P(\d+)=").items()}
    assert 40 < refused(joints_read("melfa", plan, tmp_path / "saved.prg"), text, lines, 200, 6) < 200


FILES_SLIM = pytest.mark.parametrize("files", [20, pytest.param(200, marks=pytest.mark.long)])


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('REM "zb_p1', 'REM "p1'),
        ('REM "zb_p1', 'REM "zb_p2'),
        ('REM "zb_p1 psd"\r\n', ""),
        ("STOP\r\nREM", "STOP\r\nMOVEX M1J,P,(0,0,0,0,30,0),R=5.0,H=1,MS\r\nREM"),
        ("END", ""),
    ],
)
def test_remarks_must_name_the_positions_of_a_plan(tmp_path: Path, before: str, after: str) -> None:
    plan = plan_for(tmp_path, nachi_controller.robot_file(tmp_path), nachi_controller.TARGET, count=3)
    write_program("slim", plan, ProgramMotion(), tmp_path / "zb_plan.slim")
    saved = nachi_controller.carried_out(tmp_path / "zb_plan.slim", PendantArm(plan))
    text, read_joints = saved.read_bytes().decode(), joints_read("slim", plan, saved)
    assert sorted(read_joints(text)) == [0, 1, 2]
    assert before in text
    with pytest.raises(BadInput, match=r"do not name its positions|has no end"):
        read_joints(text.replace(before, after, 1))


def test_the_tool_is_a_number(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, nachi_controller.robot_file(tmp_path), nachi_controller.TARGET, count=1)
    write_program("slim", plan, ProgramMotion(tool="3"), tmp_path / "zb_plan.slim")
    assert ",H=3,MS" in (tmp_path / "zb_plan.slim").read_text()
    with pytest.raises(BadInput, match="--tool is not the number of a tool"):
        write_program("slim", plan, ProgramMotion(tool="grip"), tmp_path / "other.slim")


@FILES_SLIM
def test_damaged_recordings_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, nachi_controller.robot_file(tmp_path), nachi_controller.TARGET, count=4)
    write_program("slim", plan, ProgramMotion(), tmp_path / "zb_plan.slim")
    saved = nachi_controller.carried_out(tmp_path / "zb_plan.slim", PendantArm(plan))
    text = saved.read_bytes().decode()
    motions = [line for line in text.split("\r\n") if "MOVEX" in line]
    lines = dict(enumerate(motions))
    assert 0.3 * files < refused(joints_read("slim", plan, saved), text, lines, files) <= files


def test_damaged_recordings_of_val3(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "tx2_60", staubli_controller.TARGET, 4)
    write_program("val3", plan, ProgramMotion(), tmp_path / "zb_plan.pjx")
    text = recorded((tmp_path / "zb_plan.dtx").read_text(), r'"zb_m\d+" .* j2="')
    lines = {int(number): line for number, line in lines_of(text, r'<Data name="zb_m(\d+)"').items()}
    assert 100 < refused(joints_read("val3", plan, tmp_path / "saved.dtx"), text, lines, 200, 6) < 200


@COUNTS
def test_damaged_recordings_of_tmscript(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "tm5_900", techman_controller.TARGET, count=5)
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"float[] zb_p{i} = {{{row}}}\n" for i, row in enumerate(rows)}
    motions = "".join(f'PTP("JPP",zb_p{i},5,500,0,false)\n' for i in lines)
    text = "define\n{\n" + "".join(lines.values()) + "}\nmain\n{\n" + motions + "}\n"
    read_joints = joints_read("tmscript", plan, tmp_path / "edited.tms")
    assert refused(read_joints, text, lines, count) < 0.9 * count


READER = next(each for maker in makers() for each in maker.read if each.name == "inform")
FILES_INFORM = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])


@FILES_INFORM
def test_damaged_files_of_a_plan_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, yaskawa_controller.robot_file(tmp_path), yaskawa_controller.TARGET, count=4)
    write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    saved = yaskawa_controller.carried_out(tmp_path / "zb_plan.jbi", PendantArm(plan))
    text = saved.read_bytes().decode()
    lines = {number: f"C{number:05d}={row}" for number, row in yaskawa_controller.positions_of(text)}
    assert len(lines) == 4
    assert 0.5 * files < refused(joints_read("inform", plan, saved), text, lines, files) < files


def test_without_the_pulses_of_the_machine_nothing_is_written(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "gp7", yaskawa_controller.TARGET, count=3)
    with pytest.raises(BadInput, match="the pulses for a degree are not stated"):
        write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    assert not (tmp_path / "zb_plan.jbi").exists()


def test_a_program_whose_positions_nobody_modified_is_no_recording(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, yaskawa_controller.robot_file(tmp_path), yaskawa_controller.TARGET, count=3)
    job = tmp_path / "zb_plan.jbi"
    write_program("inform", plan, ProgramMotion(), job)
    with pytest.raises(BadInput, match="every position is still as the plan has it"):
        READER.read(ImportJob.begin([job], plan, tmp_path / "run.jsonl"))
