"""VAL3: what is refused, and damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import staubli_controller as controller
from damaged_files import joints_read, lines_of, positions_read, recorded, refused
from program_arm import plan_for
from user_programs import judged, read, varied

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.staubli.val3 import VAL3
from zerobeam.experiments.makers.user_programs import ProgramOptions, corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("tx2_60")
ROWS = varied(ROBOT, 4)
WHOLE = controller.user_program(ROBOT, ROWS)
CODE, DATA = WHOLE[: WHOLE.rindex("<?xml")], WHOLE[WHOLE.rindex("<?xml") :]


def corrected(folder: Path, text: str, *leave: str) -> str:
    program = controller.in_files(folder / "job", text)
    return read(corrected_program(ROBOT, judged(ROBOT), program, program, ProgramOptions(leave=leave)))


def problems(folder: Path, text: str) -> str:
    with pytest.raises(BadInput) as refused:
        corrected(folder, text)
    return str(refused.value)


REFUSED = [
    "movec(pAt[0],pAt[1],tGrip,mNom)",
    "movej(appro(pAt[0],{0,0,-50,0,0,0}),tGrip,mNom)",
    "movel(compose(pAt[0],fTable,trS),tGrip,mNom)",
    "movej({0,0,90,0,0,0},tGrip,mNom)",
    "movej(jAt[nI],tGrip,mNom)",
    "movej(jOther,tGrip,mNom)",
    "movej(lib:jAt[0],tGrip,mNom)",
    "movej(pAt[0],tOther,mNom)",
    "movel(pAt[1],flange,mNom)",
    "pAt[0]=here(tGrip,fTable)",
    "pAt[nI].trsf.x=5",
    "PAT[0].trsf.x=5",
    "jAt[1]=herej()",
    "jAt[nI]=herej()",
    "tGrip.trsf.z=100",
    "fTable.trsf=trS",
    "nI=setFrame(pAt[0],pAt[1],pAt[0],fTable)",
    "call pick(pAt[0])",
    "call lib:pick()",
    "call pick()",
    'taskCreate "other",100,other()',
    "movej(pAt[0],tGrip",
]


@pytest.mark.parametrize("line", REFUSED)
@pytest.mark.usefixtures("unsolved")
def test_a_statement_that_must_not_pass_is_refused_by_its_line(tmp_path: Path, line: str) -> None:
    sentence = problems(tmp_path, CODE.replace("  waitEndMove()", f"  {line}\r\n  waitEndMove()") + DATA)
    number = CODE[: CODE.index("  waitEndMove()")].count("\n") + 1
    assert f"start.pgx line {number}: " in sentence


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('fatherId="fTable[0]"', 'fatherId="fOther[0]"', "this is not understood"),
        ('fatherId="world[0]"', 'fatherId="fTable[0]"', "this is not understood"),
        ('elbow="epositive"', 'elbow="enegative"', "configuration"),
        ('elbow="enegative"', 'elbow="epositive"', "configuration"),
        ('type="tool"', 'type="trsf"', "tgrip is not known"),
        ("<Datas>", '<!DOCTYPE a [<!ENTITY b "c">]><Datas>', "not valid XML"),
    ],
)
def test_data_that_are_not_what_they_were_are_refused(tmp_path: Path, old: str, new: str, word: str) -> None:
    assert old in DATA
    assert word in problems(tmp_path, CODE + DATA.replace(old, new, 1))


def test_entities_and_hidden_variables_are_refused(tmp_path: Path) -> None:
    entity = DATA.replace("<Database", '<!DOCTYPE a [<!ENTITY b "c">]>\r\n<Database')
    assert "document type" in problems(tmp_path, CODE + entity)
    hidden = '    <Locals><Local name="pAt" type="pointRx" size="1"/></Locals>\r\n    <Code>'
    assert "start.pgx line 4" in problems(tmp_path, CODE.replace("    <Code>", hidden) + DATA)


def test_an_application_in_inches_is_refused(tmp_path: Path) -> None:
    job = controller.in_files(tmp_path / "job", WHOLE)
    project = '<?xml version="1.0"?>\n<Project><Parameters millimeterUnit="false"/></Project>'
    job.with_name("job.pjx").write_text(project)
    with pytest.raises(BadInput, match=r"job\.pjx line 2"):
        corrected_program(ROBOT, judged(ROBOT), job, job)


def test_a_free_configuration_is_refused_by_joints_and_taken_in_a_line(tmp_path: Path) -> None:
    free = DATA.replace('elbow="epositive"', 'elbow="efree"').replace('elbow="enegative"', 'elbow="efree"')
    assert "nMove=movej(pAt[1],tGrip[0],mNom): this is not understood" in problems(tmp_path, CODE + free)
    lines = CODE.replace("nMove=movej(pAt", "nMove=movel(pAt")
    assert 'elbow="efree"' in corrected(tmp_path, lines + free)


def test_a_posture_that_is_called_otherwise_is_one_problem_with_its_reason(tmp_path: Path) -> None:
    """The points behind it are reached from it: that their joints are not known follows from it."""
    moves = "  movej(pAt[0],tGrip,mNom)\r\n  movej(pAt[1],tGrip,mNom)\r\n"
    begin = CODE.index("  movel(pAt[0]")
    code = CODE[:begin] + moves + "  waitEndMove()" + CODE[CODE.index("\r\nend") :]
    shown = re.search(r'shoulder="(\w+)"', DATA)[1]
    other = "lefty" if shown == "righty" else "righty"
    sentence = problems(tmp_path, code + DATA.replace(f'shoulder="{shown}"', f'shoulder="{other}"', 1))
    found = sentence.partition("found:")[2].partition("to do:")[0]
    assert found.count("job.dtx line") + found.count("start.pgx line") == 1
    assert f"pAt: its configuration is {other}" in found
    assert "lefty is: the centre of the wrist is in front of axis 1" in found
    assert "VAL3 reference manual" in found


def test_what_computes_a_target_is_refused_with_the_reason(tmp_path: Path) -> None:
    line = "  movej(appro(pAt[0],{0,0,-50,0,0,0}),tGrip,mNom)\r\n"
    sentence = problems(tmp_path, CODE.replace("  waitEndMove()", f"{line}  waitEndMove()") + DATA)
    assert sentence.count("start.pgx line") == 1
    assert "write it as a point of its own" in sentence


def test_names_keep_their_letters(tmp_path: Path) -> None:
    line = "  movej(jOther,tGrip,mNom)\r\n"
    sentence = problems(tmp_path, CODE.replace("  waitEndMove()", f"{line}  waitEndMove()") + DATA)
    assert "jOther has no value in this file (--leave jOther?)" in sentence
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, WHOLE, "pAt[7]")
    assert refused.value.allowed == "jAt, jAt[1], jAt[2], jAt[3], pAt, pAt[1]"


def test_what_is_left_stays_and_a_second_correction_is_refused(tmp_path: Path) -> None:
    text = corrected(tmp_path, WHOLE, "pAt[1]", "jAt[0]")
    before, after = ({line for line in each.split("\r\n") if "<Value" in line} for each in (WHOLE, text))
    assert len(before - after) == 4  # jAt[1] to jAt[3], pAt[0]
    assert "corrected before" in problems(tmp_path, text)


def test_the_mark_of_a_correction_survives_an_editor_that_drops_remarks(tmp_path: Path) -> None:
    program = controller.in_files(tmp_path / "job", WHOLE)
    done = corrected_program(ROBOT, judged(ROBOT), program, program)
    heads = {path.suffix: content.count(b"<!--") for path, content in done.files.items()}
    assert heads[".dtx"] == 1 < heads[".pgx"]  # the whole head once
    for path, content in done.files.items():
        path.write_bytes(re.sub(rb"<!--.*?-->\r?\n", b"", content))
    assert all(b"<!--" not in path.read_bytes() for path in done.files)
    with pytest.raises(BadInput, match="corrected before"):
        corrected_program(ROBOT, judged(ROBOT), program, program)
    assert len(controller.commanded(read(done), ROBOT, ROWS)) == len(ROWS)  # the variable disturbs nothing


@pytest.mark.parametrize("many", [40, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_programs_are_refused_or_have_the_same_positions(many: int) -> None:
    positions = positions_read(VAL3, ROBOT)
    lines = {
        name if key == "0" else f"{name}[{key}]": value
        for name, values in re.findall(r'<Data name="(\w+)"(.*?)</Data>', WHOLE, re.DOTALL)
        for value, key in re.findall(r'(<Value key="(\d+)"[^\n]*)', values)
    }
    assert many / 2 < refused(positions, WHOLE, lines, many, 5) < many


def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "tx2_60", controller.TARGET, 4)
    write_program("val3", plan, ProgramMotion(), tmp_path / "zb_plan.pjx")
    text = recorded((tmp_path / "zb_plan.dtx").read_text(), r'"zb_m\d+" .* j2="')
    lines = {int(number): line for number, line in lines_of(text, r'<Data name="zb_m(\d+)"').items()}
    assert 100 < refused(joints_read("val3", plan, tmp_path / "saved.dtx"), text, lines, 200, 6) < 200


@pytest.mark.parametrize("namespace", ["ProgramNameSpace", "DataNameSpace"])
def test_an_application_of_s6_is_refused_by_its_name(tmp_path: Path, namespace: str) -> None:
    """Its files have other elements, which were "not understood" one by one."""
    older = f'<?xml version="1.0"?>\n<programList xmlns="{namespace}"><program name="a"/></programList>\n'
    job = controller.in_files(tmp_path / "job", WHOLE)
    job.with_name("old.pgx").write_text(older)
    with pytest.raises(BadInput, match="of VAL3 s6") as refused:
        corrected_program(ROBOT, judged(ROBOT), job, job.with_name("new" + job.suffix))
    assert refused.value.found == f'xmlns="{namespace}"'
