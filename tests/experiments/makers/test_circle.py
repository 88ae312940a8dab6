"""Plan → program → an interpreter on a simulated arm → import → offsets, for every language."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import denso_controller
import doosan_controller
import epson_controller
import fanuc_interpreter
import franka_programs
import import_files as importers
import kawasaki_controller
import mitsubishi_controller
import nachi_controller
import numpy as np
import pytest
import robodk_interpreter
import ros_interpreter
import staubli_controller
import techman_controller
import urscript_interpreter
import yaskawa_controller
from krl_interpreter import KrlController
from program_arm import TRUTH, PendantArm, plan_for
from rapid_interpreter import RapidController

from zerobeam.experiments.makers.calibration import calibration
from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, steps_of, write_program
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run, write_run


def rapid(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("rapid", plan, ProgramMotion(), folder / "zb_plan.mod")
    log = folder / "zb_plan.log"
    log.write_text(RapidController((folder / "zb_plan.mod").read_text(), arm).run())
    return importers.import_program_log([log], [], plan, folder / "run.jsonl", source="RAPID")


def urscript(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("urscript", plan, ProgramMotion(listener="192.168.0.7:50007"), folder / "p.script")
    log, sent = urscript_interpreter.carried_out((folder / "p.script").read_text(), arm)
    (folder / "log_history.txt").write_text(log)
    (folder / "heard.txt").write_text("".join(sent))
    by_log, by_socket = (
        importers.import_program_log([folder / name], [], plan, folder / "run.jsonl", source="URScript")
        for name in ("log_history.txt", "heard.txt")
    )
    logged, heard = (
        [shot.model_copy(update={"source": None}) for shot in each.shots] for each in (by_log, by_socket)
    )
    assert logged == heard
    return by_log


def krl(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("krl", plan, ProgramMotion(), folder / "zb_plan.src")
    data = folder / "zb_plan.dat"
    controller = KrlController((folder / "zb_plan.src").read_text(), data.read_text(), arm)
    while controller.start():
        arm.centre()
    data.unlink()
    data.write_text(controller.data())
    return importers.import_kuka([data], [], plan, folder / "run.jsonl")


def fanuc(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("fanuc", plan, ProgramMotion(register=11), folder / "zb_plan.ls")
    saved = folder / "posreg.va"
    saved.write_text(fanuc_interpreter.carried_out((folder / "zb_plan.ls").read_text(), arm))
    return importers.import_fanuc([saved], [], plan, folder / "run.jsonl", register=11)


def robodk(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("robodk", plan, ProgramMotion(), folder / "zb_plan.py")
    robodk_interpreter.carried_out((folder / "zb_plan.py").read_text(), arm)
    return importers.import_program_log(
        [Path("zb_plan.log")], [], plan, folder / "run.jsonl", source="RoboDK"
    )


def ros(folder: Path, plan: Plan, arm: PendantArm) -> Imported:
    write_program("ros", plan, ProgramMotion(), folder / "plan_trajectories.yaml")
    said = folder / "recorded.yaml"
    said.write_text(ros_interpreter.carried_out((folder / "plan_trajectories.yaml").read_text(), arm))
    return importers.import_joint_states([said], [], plan, folder / "run.jsonl")


ARMS: dict[str, tuple[Callable[..., Imported], tuple[float, float, float]]] = {
    "irb1600": (rapid, (900.0, 0.0, 0.0)),
    "irb120": (rapid, (450.0, 0.0, 100.0)),
    "ur5e": (urscript, (600.0, 0.0, 100.0)),
    "ur10e": (urscript, (800.0, 0.0, 100.0)),
    "kr6_r900": (krl, (600.0, 0.0, 100.0)),
    "kr10_r1100_2": (krl, (700.0, 0.0, 100.0)),
    "lrmate_200id": (fanuc, (500.0, 0.0, 0.0)),
    "m10ia": (fanuc, (800.0, 0.0, 0.0)),
    "gp7": (robodk, (600.0, 0.0, 100.0)),
    "xarm6": (ros, (400.0, 0.0, 100.0)),
    "tx2_60": (ros, (450.0, 0.0, 100.0)),
}


def offsets_come_back(folder: Path, plan: Plan, imported: Imported) -> None:
    """The offsets of what was imported are the true ones."""
    assert [shot.shot for shot in imported.shots] == list(range(len(plan.postures)))
    assert imported.header.provenance["plan sha256"] == plan.sha256
    run = folder / "run.jsonl"
    write_run(run, imported.header, imported.shots)
    # Axes 2 and 3 are parallel: from twelve random postures some of these offsets are weakly observable.
    answer = calibration(read_run(run), allow_weak=True)
    offsets: dict[str, Any] = {offset.name: offset for offset in answer.offsets}
    assert offsets["delta1"].status == "held"
    for name, true in TRUTH.items():
        offset = offsets[name]
        assert offset.status in ("identified", "weak", "assumed")
        assert offset.row.std < 0.3
        assert abs(offset.row.estimate - true) < 3 * offset.row.std, (name, offset.row)


@pytest.mark.parametrize("robot", ARMS)
@pytest.mark.at_length(r"^(?!irb1600$)")
def test_offsets_come_back_through_the_program_of_every_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, robot: str
) -> None:
    monkeypatch.chdir(tmp_path)
    carried_out, target = ARMS[robot]
    plan = plan_for(tmp_path, robot, target)
    arm = PendantArm(plan)
    imported = carried_out(tmp_path, plan, arm)
    # To the plan's last digit, in its order.
    assert arm.moves == [list(step.joints) for step in steps_of(plan, ProgramMotion(j3="link"))]
    offsets_come_back(tmp_path, plan, imported)


# Languages whose statements are lines, each with its controller.
_MODULES = (
    denso_controller,
    doosan_controller,
    epson_controller,
    kawasaki_controller,
    mitsubishi_controller,
    nachi_controller,
    staubli_controller,
    techman_controller,
    yaskawa_controller,
)
CONTROLLERS = {controller.KIND: controller for controller in _MODULES}


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.one_in(7)
def test_the_circle_of_a_language_of_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    controller = CONTROLLERS[kind]
    robot = controller.robot_file(tmp_path) if hasattr(controller, "robot_file") else controller.ROBOT
    plan = plan_for(tmp_path, robot, controller.TARGET)
    arm = PendantArm(plan)
    path = tmp_path / f"zb_plan{controller.SUFFIX}"
    write_program(kind, plan, ProgramMotion(), path)
    saved = controller.carried_out(path, arm)
    assert np.abs(np.array(arm.moves) - np.degrees(plan.postures)).max() < controller.STEP_DEG
    reader = next(each for maker in makers() for each in maker.read if each.name == controller.READER)
    job = ImportJob.begin([saved], plan, tmp_path / "run.jsonl")
    offsets_come_back(tmp_path, plan, reader.read(job))


@pytest.mark.long
def test_the_circle_of_a_joint_list(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Radians out and back, of seven joints; the arm is corrected by its model."""
    monkeypatch.chdir(tmp_path)
    plan = plan_for(tmp_path, "panda", (450.0, 0.0, 0.0))
    arm = PendantArm(plan)
    write_program("franka", plan, ProgramMotion(), tmp_path / "zb_plan.py")
    saved = franka_programs.carried_out(tmp_path / "zb_plan.py", arm)
    assert np.abs(np.array(arm.moves) - np.degrees(plan.postures)).max() < 1e-9
    reader = next(each for maker in makers() for each in maker.read if each.name == "franka")
    imported = reader.read(ImportJob.begin([saved], plan, tmp_path / "run.jsonl"))
    offsets_come_back(tmp_path, plan, imported)
