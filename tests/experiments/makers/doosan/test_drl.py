"""DRL: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import doosan_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, lines_of, positions_read, refused
from program_arm import plan_for
from user_programs import OFFSETS, TABLE, TOOL, corrected_for, read, varied

from zerobeam.experiments.makers.doosan.drl_language import DRL
from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.program_parts import ProgramFacts, Source
from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.orientation import from_zyz

ROBOT = load_robot("m1013")
TOOLS, FRAMES = ["grip=0,0,100,0,0,0", "other=0,0,50,0,0,0"], ["DR_WORLD=0,0,500,0,0,0"]
COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
JOB = """home = posj(0, 0, 90, 0, 90, 0)
set_tcp("grip")
movej(home, vel=30)
{}
"""
P = "posx(400, 100, 500, 0, 180, 0)"


def corrected(folder: Path, text: str, choices: ProgramOptions | None = None) -> str:
    """With the poses of the tools and frames that the program names."""
    if choices is None:
        here = [[one for one in each if one.split("=")[0] in text] for each in (TOOLS, FRAMES)]
        choices = ProgramOptions(tools=here[0], frames=here[1])
    path = folder / "job.drl"
    path.write_text(text)
    return read(corrected_for(ROBOT, OFFSETS, ROBOT, path, choices))


@pytest.mark.parametrize(
    "lines",
    [
        f"movel({P}, v=100, a=200)",
        f"movejx({P}, vel=30, sol=2)",
        f"p1 = {P}\nmovel(p1, [100, 50], [200, 100], ref=DR_WORLD, mod=DR_MV_MOD_ABS, radius=5)",
        f"for i in range(3):\n    movej(home)\n    movel({P})",
        f"def go():\n    set_tcp('other')\n    movej(home)\n    movel({P})\nmovej(home)\nmovel({P})\ngo()",
        "count = 0\ncount += 1\nif count > 2 and get_digital_input(1) == ON:\n    tp_popup('a b')",
    ],
)
@pytest.mark.one_in(2)
def test_what_is_understood_is_corrected(tmp_path: Path, lines: str) -> None:
    text = corrected(tmp_path, JOB.format(lines))
    assert "# zerobeam export program: job.drl with the offsets below" in text
    moved = [float(value) for value in re.search(r"^home = posj\((.*)\)", text, re.MULTILINE)[1].split(",")]
    np.testing.assert_allclose(np.array(moved), [0, 0, 90, 0, 90, 0] - OFFSETS, atol=1e-4)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (f"movel({P}, mod=DR_MV_MOD_REL)", "line 4: movel({P}, mod=DR_MV_MOD_REL): this is not understood"),
        (f"movel({P}, ref=DR_TOOL)", "line 4: movel({P}, ref=DR_TOOL): this is not understood"),
        (f"movel({P}, ref=1)", "this is not understood"),
        (f"movel({P}, ref=101)", "frame 101 is not known; state --frame 101="),
        (f"movel({P}, 100, 200, 2, 0, 101)", "this is not understood"),
        (f"movel({P}, ra=DR_MV_RA_OVERRIDE)", "this is not understood"),
        (f"movejx({P})", "this is not understood"),
        (f"movejx({P}, sol=6)", "it is not known which joints have the configuration"),
        (f"movejx({P}, sol=2)\nmovejx(posx(400, 100, 500, 0, 180, 0), sol=8)", "line 5"),
        ("movel(home)", "line 4: movel(home): the motion takes a pose alone"),
        (f"p1 = {P}\nmovej(p1)", "line 5: movej(p1): the motion takes joints alone"),
        (f"p1 = {P}\nmovejx(p1, sol=2)\nmovejx(p1, sol=3)", "p1 is used with different configurations"),
        (f"p1 = {P}\nmovejx(p1, sol=2)\nmovel(p1)", "line 6: movel(p1): p1 is used with different"),
        (f"p1 = {P}\nmovel(p1)\nmovel(p1, ref=DR_WORLD)", "p1 is used with different tools or frames"),
        (f"amovel({P})", "this is not understood"),
        (f"movec({P}, {P})", "this is not understood"),
        ("movesj([home, home])", "this is not understood"),
        ("move_home(1)", "this is not understood"),
        ("done = move_home(1)", "this is not understood"),
        ("done = movej(home)", "this is not understood"),
        ("p2 = trans(home, [0, 0, 10, 0, 0, 0], DR_BASE, DR_BASE)", "this is not understood"),
        ("home[2] = 80", "home is used or changed when the program runs"),
        ("other = home", "home is used or changed when the program runs"),
        ("home = posj(0, 0, 80, 0, 90, 0)", "home has a value more than once"),
        ("movej(posj(0, 0, 90))", "has 3 numbers, and not 6"),
        ("movej(posj(0, 0, a, 0, 90, 0))", "this is not understood"),
        ("movej(elsewhere)", "elsewhere has no value in this file (--leave elsewhere?)"),
        ("spare = posx(1, 2, 3, 4, 5, 6)", "spare is not the target of a motion here"),
        ("limits = [1, 2, 3, 4, 5, 6]", "this is not understood"),
        ("if ready: movej(home)", "this is not understood"),
        ("movej(home); movej(home)", "this is not understood"),
        ("movej(\n    home)", "line 4: movej(: this is not understood"),
        ('"""', "this is not understood"),
        ("task_compliance_ctrl()", "this is not understood"),
        ("pick()", "what pick does is not known; --call pick"),
        ("set_tcp(name)", "this is not understood"),
        ("wait_manual_guide()", "this is not understood"),
        (f"if x:\n    set_tcp('other')\nmovel({P})", "line 6: the target in line 6: which tool is active"),
        (f"def go():\n    movel({P})\ngo()", "which tool is active here is not known"),
        ("if x:\n    def go():\n        movej(home)", "line 5: def go():: this is not understood"),
    ],
)
def test_what_is_not_understood_is_named(lines: str, told: str) -> None:
    facts = ProgramFacts(
        {"grip": from_zyz((0, 0, 100, 0, 0, 0)), "other": np.eye(4)}, {"DR_WORLD": np.eye(4)}
    )
    parsed = for_correction(DRL).targets(Source(JOB.format(lines), ROBOT, facts))
    sentences = [f"line {line}: {sentence}" for line, sentence in parsed.problems]
    assert any(told.replace("{P}", P)[:60] in sentence for sentence in sentences), sentences


def test_numbers_that_look_like_a_position_are_none_of_speeds(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="line 4: 10, 20, 30, 40, 50, 60: it is not said what this position"):
        corrected(tmp_path, JOB.format("set_velj([10, 20, 30, 40, 50, 60])"))


def test_behind_a_branch_the_configuration_is_not_known(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="nothing says in which configuration"):
        corrected(tmp_path, JOB.format(f"if x:\n    movej(home)\nmovel({P})"))


def test_a_tool_that_the_program_does_not_set_is_asked_for(tmp_path: Path) -> None:
    text = JOB.format(f"movel({P})").replace('set_tcp("grip")', "wait(1)")
    with pytest.raises(BadInput, match="the program does not set the tool; state --tool X,Y,Z,A,B,C"):
        corrected(tmp_path, text, ProgramOptions())


def test_a_solution_is_that_of_the_joints(tmp_path: Path) -> None:
    """Of one pose with another `sol` the correction is another."""
    texts = {corrected(tmp_path, JOB.format(f"movejx({P}, sol={sol})")).split("movejx")[1] for sol in (2, 3)}
    values = [np.array(re.findall(r"-?[\d.]+", text)[:3], dtype=float) for text in sorted(texts)]
    assert np.linalg.norm(values[0] - values[1]) > 0.1


@pytest.mark.parametrize("reader", ["program", "log"])
@COUNTS
def test_damaged_recordings(tmp_path: Path, reader: str, count: int) -> None:
    plan = plan_for(tmp_path, "m1013", controller.TARGET, count=5)
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


@COUNTS
def test_damaged_programs(count: int) -> None:
    text = controller.user_program(ROBOT, varied(ROBOT, 4))
    facts = {"grip": TOOL}, {str(controller.FRAME): TABLE}
    positions = positions_read(DRL, ROBOT, lambda: ProgramFacts(*facts))
    assert count / 2 < refused(positions, text, lines_of(text, r"(\w+) = pos[jx]"), count) < count


def test_tools_and_frames_that_are_missing_are_named_at_once(tmp_path: Path) -> None:
    lines = f"movel({P}, ref=101)\nset_tcp('other')\nmovel({P}, ref=DR_WORLD)"
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, JOB.format(lines), ProgramOptions())
    form = "X,Y,Z,A,B,C"
    stated = [
        f"--tool grip={form}",
        f"--tool other={form}",
        f"--frame 101={form}",
        f"--frame DR_WORLD={form}",
    ]
    assert str(refused.value.remedy).startswith(f"state {' '.join(stated)}; ")
    frames = [*FRAMES, "101=0,0,0,0,0,0"]
    assert "movel" in corrected(tmp_path, JOB.format(lines), ProgramOptions(tools=TOOLS, frames=frames))
