"""A plan's program is no recording: unmodified, the import of its own maker refuses it."""

import contextlib
from pathlib import Path

import doosan_controller
import pytest
import yaskawa_controller
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.contents import contents_of
from zerobeam.experiments.makers.generic.joint_logs import CsvLayout, import_csv
from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.maker import Maker, PlanProgram, makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, program_texts, write_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.robot_file import BUILT_IN

NOT_MEASURED = (
    "the file is a plan's program, not what the program recorded|these are the planned postures"
    "|every position is still as the plan has it|the file has no points"
    "|a message has no names or no positions"
)
PROGRAMS = [(maker, program) for maker in makers() for program in maker.program]


def robot_for(maker: Maker, folder: Path) -> str:
    """A robot of the maker: of most makers the arm of another one."""
    if maker.vendor == "yaskawa":
        return yaskawa_controller.robot_file(folder)
    if maker.vendor in ("franka", "kawasaki", None):
        return "panda" if maker.vendor == "franka" else "rs007n"
    text = (BUILT_IN / "rs007n.yaml").read_text()
    text = text.replace("vendor: kawasaki", f"vendor: {maker.vendor}")
    path = folder / "mine.yaml"
    path.write_text(text.replace("name: rs007n", "name: mine").replace("model: RS007N", "model: mine"))
    return str(path)


def imports(maker: Maker, program: PlanProgram, file: Path, job: ImportJob) -> list[Imported]:
    """What each reader of the maker makes of a file; BadInput of the last that refuses it."""
    readers = [each for each in maker.read if maker.vendor is not None or each.name == program.name]
    if program.name == "csv":
        joints = tuple(file.read_text().splitlines()[0].split(",")[2:])
        return [import_csv(job, CsvLayout("deg", header_row=True, columns=joints))]
    return [reader.read(job) for reader in readers]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("maker", "program"), PROGRAMS, ids=[program.name for _, program in PROGRAMS])
def test_a_plans_program_is_refused_by_its_own_import(
    maker: Maker, program: PlanProgram, tmp_path: Path
) -> None:
    target = (450.0, 0.0, 0.0) if maker.vendor == "franka" else (500.0, 0.0, 100.0)
    plan = plan_for(tmp_path, robot_for(maker, tmp_path), target, count=3)
    texts = program_texts(program.name, plan, ProgramMotion(), tmp_path / program.files[0])
    assert {path.name for path in texts} == {*program.files}
    header = tmp_path / "header.yaml"
    header.write_text(plan.path.read_text().split("postures_deg")[0].replace("schema: zerobeam/plan/1\n", ""))
    for path, text in texts.items():
        path.write_text(text)
        with pytest.raises(BadInput, match=NOT_MEASURED):
            imports(maker, program, path, ImportJob.begin([path], plan, tmp_path / "run.jsonl"))
        if program.name != "csv":  # any table is: only the plan shows that it is planned
            job = ImportJob.begin([path], header, tmp_path / "run.jsonl", ["psd"])
            with pytest.raises(BadInput, match=f"{NOT_MEASURED}|may still be the planned ones"):
                imports(maker, program, path, job)
        with contextlib.suppress(BadInput):  # the app refuses it
            assert contents_of(path).form != "program log"


def doosan_plan(folder: Path) -> Plan:
    return plan_for(folder, "m1013", doosan_controller.TARGET, count=3)


def test_a_program_whose_positions_were_taught_again_is_read_although_it_writes_a_log(tmp_path: Path) -> None:
    plan = doosan_plan(tmp_path)
    path = tmp_path / "zb_plan.drl"
    write_program("drl", plan, ProgramMotion(), path)
    maker, program = next(each for each in PROGRAMS if each[1].name == "drl")
    first = f"{plan.postures[0][0] * plan.robot.display[0]:.4f}".rstrip("0")
    path.write_text(path.read_text().replace(f"posj({first}", "posj(" + f"{float(first) + 0.25:.4f}", 1))
    (made,) = imports(maker, program, path, ImportJob.begin([path], plan, tmp_path / "run.jsonl"))
    assert [shot.joints_deg[0] - float(first) for shot in made.shots] == [pytest.approx(0.25)]


def test_the_log_is_still_a_log(tmp_path: Path) -> None:
    plan = doosan_plan(tmp_path)
    path = tmp_path / "zb_plan.drl"
    write_program("drl", plan, ProgramMotion(), path)
    log = doosan_controller.carried_out(path, PendantArm(plan))
    assert contents_of(log).form == "program log"
    log.write_text(log.read_text() + path.read_text())
    maker, program = next(each for each in PROGRAMS if each[1].name == "spel")
    with pytest.raises(BadInput, match="not what the program recorded"):
        imports(maker, program, log, ImportJob.begin([log], plan, tmp_path / "run.jsonl"))
