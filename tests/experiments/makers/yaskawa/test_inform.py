"""INFORM: what is refused, and damaged jobs: refused, or read as they are meant."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import yaskawa_controller as controller
from damaged_files import joints_read, lines_of, positions_read, refused
from program_arm import PendantArm, plan_for
from user_programs import TABLE, TOOL, judged, read, varied

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.program_parts import ProgramFacts
from zerobeam.experiments.makers.user_programs import ProgramOptions, corrected_program
from zerobeam.experiments.makers.yaskawa.inform import INFORM
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

READER = next(each for maker in makers() for each in maker.read if each.name == "inform")
FILES = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])
JOB = """/JOB
//NAME JOB
//POS
///NPOS 2,0,0,0,0,0
///TOOL 3
///POSTYPE PULSE
///PULSE
C00000=0,20000,-30000,0,40000,0
///USER 2
///POSTYPE USER
///RECTAN
///RCONF 0,0,0,0,0,0,0,0
C00001=239.261,62.882,198.869,-151.8258,-60.8092,-66.2771
//INST
///DATE 2020/01/01 12:00
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVJ C00000 VJ=50.00
{}
END
"""


@cache
def gp7() -> Robot:
    with TemporaryDirectory() as folder:
        return load_robot(controller.robot_file(Path(folder)))


def corrected(folder: Path, text: str, choices: ProgramOptions = controller.STATED) -> str:
    robot = gp7()
    (folder / "in.jbi").write_bytes(text.encode())
    return read(corrected_program(robot, judged(robot), folder / "in.jbi", folder / "out.jbi", choices))


def test_a_job_is_corrected(tmp_path: Path) -> None:
    text = corrected(tmp_path, JOB.format('MOVL C00001 V=100.0 PL=1 NWAIT\nDOUT OT#(3) ON\nMSG "it\'s"'))
    assert "NOP\n'zerobeam export program\n" in text
    assert all(len(line) <= 32 for line in text.splitlines() if line.startswith("'"))
    pulses = re.search("^C00000=(.*)$", text, re.MULTILINE)[1].split(",")
    moved = np.array(list(map(int, pulses))) - [0, 20000, -30000, 0, 40000, 0]
    np.testing.assert_allclose(moved / controller.PULSES, [0, 0.9, -0.6, -0.4, 0.7, -0.5], atol=2e-3)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("IMOV P001 V=10.0 RF", "line 20: IMOV P001 V=10.0 RF: this is not understood"),
        ("SFTON P001 UF#(1)", "line 20: SFTON P001 UF#(1): this is not understood"),
        ("MOVC C00001 V=10.0", "line 20: MOVC C00001 V=10.0: this is not understood"),
        ("MOVL C00001 V=10.0 UNTIL IN#(1)=ON", "line 20: MOVL C00001 V=10.0 UNTIL IN#(1)=ON: this is not"),
        ("MOVJ C00001 BC00001 VJ=10.00", "BC00001 VJ=10.00: this is not understood"),
        ("MOVJ P001 VJ=10.00", "line 20: P001 has no value in this file (--leave P001?)"),
        ("MOVJ C00007 VJ=10.00", "line 20: C00007 has no value in this file"),
        ("SET P001 P002", "line 20: SET P001 P002: this is not understood"),
        ("GETS PX001 $PX000", "line 20: GETS PX001 $PX000: this is not understood"),
        ("CHANGE TOOL#(1)", "line 20: CHANGE TOOL#(1): this is not understood"),
        ("MFRAME UF#(2) P001 P002 P003", "this is not understood"),
        ("CALL JOB:GRIP", "line 20: CALL JOB:GRIP: what GRIP does is not known; --call GRIP"),
        (
            "C00002=1,2,3,4,5,6",
            "line 20: C00002=1,2,3,4,5,6: nothing says whether these are joints or a pose",
        ),
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, line: str, said: str) -> None:
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, JOB.format(line))
    assert said in " ".join(str(refused.value).split())


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        ("///RCONF 0,0,0,0", "///RCONF 0,0,0,1", "line 12: ///RCONF 0,0,0,1,0,0,0,0: this is not understood"),
        ("///RCONF 0,0,0,0,0,0,0,0\n", "", "C00001 has no configuration"),
        ("///POSTYPE USER\n", "", "which frame is active here is not known"),
        ("///POSTYPE USER", "///POSTYPE TOOL", "line 10: ///POSTYPE TOOL: this is not understood"),
        ("///USER 2", "///USER 5", "frame 5 is not known; state --frame 5="),
        ("///TOOL 3", "///TOOL 1", "tool 1 is not known; state --tool 1="),
        ("///GROUP1 RB1", "///GROUP1 RB1,BS1", "///GROUP1 RB1,BS1: this is not understood"),
        ("///PULSE\n", "", "nothing says whether these are joints or a pose"),
        ("C00000=0,", "C00000=0.5,", "C00000 has a number that no position has"),
        ("C00001=", "C00000=", "C00000 has a value more than once"),
        (",0,40000,0\n", ",0,40000\n", "C00000 has 5 numbers, and not 6"),
        ("C00001=", "P00001=", "P00001 belongs to other programs too (--leave P00001?)"),
    ],
)
def test_positions_that_are_not_understood(tmp_path: Path, line: str, instead: str, said: str) -> None:
    assert line in JOB
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, JOB.replace(line, instead, 1).format("MOVL C00001 V=100.0"))
    assert said in " ".join(str(refused.value).split())


def test_a_pose_in_another_turn_than_its_configuration_states(tmp_path: Path) -> None:
    """T at -179.8 degrees would be beyond -180 where it is corrected; at -170 it is not."""
    near = JOB.replace("40000,0\n", f"40000,{round(-170 * 455.1)}\n").format("MOVL C00001 V=100.0")
    pose = re.search("C00001=(.*)", JOB)[1]
    assert "zerobeam" in corrected(
        tmp_path, near.replace(pose, "204.134,41.935,180.451,173.6625,8.4775,156.2545")
    )
    with pytest.raises(BadInput, match="another turn than its configuration states"):
        corrected(tmp_path, near.replace(pose, "203.801,43.707,179.821,167.6068,7.0943,147.8054"))


@FILES
def test_damaged_files_of_a_plan_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=4)
    write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    saved = controller.carried_out(tmp_path / "zb_plan.jbi", PendantArm(plan))
    text = saved.read_bytes().decode()
    lines = {number: f"C{number:05d}={row}" for number, row in controller.positions_of(text)}
    assert len(lines) == 4
    assert 0.5 * files < refused(joints_read("inform", plan, saved), text, lines, files) < files


@FILES
def test_damaged_programs_are_refused_or_mean_what_they_meant(files: int) -> None:
    text = controller.user_program(gp7(), varied(gp7(), 4))
    facts = {"3": TOOL}, {"2": TABLE}
    read_positions = positions_read(INFORM, gp7(), lambda: ProgramFacts(*facts))

    def positions(content: str) -> dict[str, Any]:
        """Without pulses as a pose: no arm reaches it."""
        return {
            name: position
            for name, position in read_positions(content).items()
            if np.ndim(position) == 1 or np.abs(position).max() < 1e4
        }

    assert 0.5 * files < refused(positions, text, lines_of(text, r"(C0\d+)="), files) < files


def test_without_the_pulses_of_the_machine_nothing_is_written(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "gp7", controller.TARGET, count=3)
    with pytest.raises(BadInput, match="the pulses for a degree are not stated"):
        write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    assert not (tmp_path / "zb_plan.jbi").exists()


def test_position_variables_that_are_left_stay_as_they_are(tmp_path: Path) -> None:
    variable = "P00001=0,20000,-30000,0,40000,0"
    text = JOB.replace("///USER 2\n", f"{variable}\n///USER 2\n").format("MOVJ P00001 VJ=10.00")
    left = ProgramOptions(tools=["3=10,-5,120,0,30,20"], frames=["2=300,-100,50,0,0,15"], leave=["P00001"])
    text = text.replace("C00001=", "C00002=").replace("MOVJ P00001", "MOVL C00002 V=10.0\nMOVJ P00001")
    assert f"\n{variable}\n" in corrected(tmp_path, text, left)


def test_a_program_whose_positions_nobody_modified_is_no_recording(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=3)
    job = tmp_path / "zb_plan.jbi"
    write_program("inform", plan, ProgramMotion(), job)
    with pytest.raises(BadInput, match="every position is still as the plan has it"):
        READER.read(ImportJob.begin([job], plan, tmp_path / "run.jsonl"))
