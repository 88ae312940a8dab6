"""A run with geometry, out again: robot file, URDF, JSON, and what controllers' files say of it."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from export_runs import HOSTILE, arm_run, urdf_file
from geometry_runs import geometry_run, on

from zerobeam.analysis.diagnostics.values_to_enter import values_to_enter
from zerobeam.analysis.ladder import solve_run
from zerobeam.experiments.makers.abb import rapid_text
from zerobeam.experiments.makers.calibration import Holds, RobotCalibration, calibration
from zerobeam.experiments.makers.generic.robot_files import robot_text, urdf_text
from zerobeam.experiments.makers.generic.written_tables import csv_text, json_text
from zerobeam.experiments.makers.maker import makers
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN, load_robot, stated_rows
from zerobeam.model.files.run import Run
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Problem


def told(run: Run, holds: Holds = "links", **how: bool) -> RobotCalibration:
    return calibration(run, allow_weak=True, holds=holds, **how)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return geometry_run(tmp_path_factory.mktemp("geometry"))


@pytest.fixture(scope="module")
def answer(run: Run) -> RobotCalibration:
    return told(run)


def postures(robot: Robot) -> Matrix:
    return np.random.default_rng(3).uniform(robot.lower, robot.upper, (200, robot.n))


def calibrated_poses(run: Run, answer: RobotCalibration) -> Matrix:
    """Poses of the calibrated model, by the symbolic one: links moved, offsets added."""
    geometry = Problem.from_run(run).geometry
    moved = geometry.applied(run.robot, np.array([own.applied_rad for own in answer.geometry]))
    return moved.fk(postures(run.robot) + [own.applied_rad for own in answer.offsets], "rad")


@pytest.mark.long
def test_a_robot_file_has_the_kinematics_of_the_calibrated_model(
    run: Run, answer: RobotCalibration, tmp_path: Path
) -> None:
    path = tmp_path / "corrected.yaml"
    path.write_text(robot_text(run, answer), encoding="utf-8")
    robot = load_robot(path)
    np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, answer), atol=1e-9)
    assert [(j.name, j.kind, j.lower, j.upper, j.speed) for j in robot.joints] == [
        (j.name, j.kind, j.lower, j.upper, j.speed) for j in run.robot.joints
    ]
    assert robot.vendor == run.robot.vendor is not None
    nominal = run.robot.fk(postures(robot), "rad")
    assert abs(nominal - calibrated_poses(run, answer)).max() > 1.0
    assert "J2" in path.read_text(encoding="utf-8").split("schema:")[0]  # its beta is said


def test_a_new_urdf_has_the_same(run: Run, answer: RobotCalibration, tmp_path: Path) -> None:
    path = tmp_path / "corrected.urdf"
    path.write_text(urdf_text(run, answer), encoding="utf-8")
    robot = read_urdf(path, "base", "flange")
    np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, answer), atol=1e-9)
    assert [(j.name, j.kind) for j in robot.joints] == [(j.name, j.kind) for j in run.robot.joints]
    np.testing.assert_allclose(robot.lower, run.robot.lower)
    np.testing.assert_allclose([j.speed for j in robot.joints], [j.speed for j in run.robot.joints])


@pytest.mark.long
def test_the_same_run_on_the_exported_robot_has_nothing_left(
    run: Run, answer: RobotCalibration, tmp_path: Path
) -> None:
    """But for what the priors held back, offsets and links come out as 0."""
    path = tmp_path / "corrected.yaml"
    path.write_text(robot_text(run, answer), encoding="utf-8")
    again = on(run, load_robot(path))
    solution = solve_run(Problem.from_run(again), run.header)
    first = {own.row.name: own.row for own in (*answer.offsets, *answer.geometry)}
    compared = 0
    for row in solution.parameters:
        if row.group not in ("offset", "geometry") or row.estimate is None or row.std is None:
            continue
        before = first[row.name]
        assert abs(row.estimate) < 0.7 * row.std, row.name
        if before.estimate is not None and abs(before.estimate) > 10 * row.std:
            assert abs(row.estimate) < 0.05 * abs(before.estimate), row.name
            compared += 1
    assert compared >= 5


@pytest.mark.long
def test_a_urdf_takes_links_into_its_origins(tmp_path: Path) -> None:
    ref = {"urdf": urdf_file(tmp_path).name, "base": "base", "tip": "tool"}
    run = geometry_run(tmp_path, ref, {"link2.a": 0.3, "link3.alpha": 0.08})
    answer = told(run)
    path = tmp_path / "corrected.urdf"
    path.write_bytes(urdf_text(run, answer).encode())
    robot = read_urdf(path, "base", "tool")
    assert sum(own.exported for own in answer.geometry) > 5
    np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, answer), atol=1e-9)
    with pytest.raises(BadInput, match="no Denavit-Hartenberg rows"):
        robot_text(run, answer)


@pytest.mark.long
def test_a_tip_that_the_last_joint_moves_cannot_hold_the_last_link(
    tmp_path: Path, refused: Callable[..., BadInput]
) -> None:
    ref = {"urdf": urdf_file(tmp_path).name, "base": "base", "tip": "l6"}
    run = geometry_run(tmp_path, ref, {"link2.a": 0.3})
    answer = told(run)
    error = refused(urdf_text, run, answer)
    assert "the last joint moves the tip" in error.what
    names = str(error.remedy).partition("exclude by name: ")[2].replace("--without ", "").split()
    assert names
    path = tmp_path / "corrected.urdf"
    without = calibration(run, allow_weak=True, holds="links", without=names)
    path.write_bytes(urdf_text(run, without).encode())
    robot = read_urdf(path, "base", "l6")
    np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, without), atol=1e-9)


@pytest.mark.long
def test_a_urdf_without_a_place_for_the_last_link_is_written_without_it_and_says_so(tmp_path: Path) -> None:
    ref = {"urdf": urdf_file(tmp_path).name, "base": "base", "tip": "l6"}
    run = geometry_run(tmp_path, ref, {"link2.a": 0.3})
    out = tmp_path / "corrected.urdf"
    done = zerobeam("export", "urdf", run.path, "-o", out, "--allow-weak")
    assert done.status == 0, done.err
    assert "NOT IN THIS FILE, as nominal: link6.a, link6.b, link6.d" in " ".join(done.out.split())
    names = [f"link6.{axis}" for axis in ("a", "b", "d", "alpha", "beta")]
    without = calibration(run, allow_weak=True, holds="links", without=names)
    robot = read_urdf(out, "base", "l6")
    np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, without), atol=1e-9)


def test_what_is_unidentifiable_is_as_in_the_estimate_of_all_and_has_no_number(
    run: Run, answer: RobotCalibration
) -> None:
    """At nominal it would spoil what it is confounded with: the arm is the estimate of all together."""
    unknown = [row for row in answer.geometry if row.status == "unidentifiable"]
    assert unknown
    for row in unknown:
        assert (row.applied, row.exported, row.row.estimate) == (0.0, False, None)
    head = " ".join(answer.head)
    assert all(f"{row.name}: UNIDENTIFIABLE by itself, as in the estimate" in head for row in unknown)
    assert answer.left_out == ()
    names = [row.name for row in unknown]
    without = calibration(run, allow_weak=True, holds="links", without=names)
    assert all(row.applied_rad == 0.0 for row in without.geometry if row.name in names)
    assert {row.name for row in without.left_out} == set(names)
    assert without.rms_mm[1] > answer.rms_mm[1]


@pytest.mark.long
def test_values_for_nominal_geometry_are_not_the_estimates(run: Run, answer: RobotCalibration) -> None:
    """Whatever holds offsets alone gets one and the same, whatever holds links the estimates."""
    values = values_to_enter(solve_run(Problem.from_run(run), run.header))
    for holds in ("offsets", "all"):
        rows = told(run, holds).offsets
        assert {row.name: row.applied for row in rows if row.exported} == pytest.approx(values)
    assert all(row.applied == (row.row.estimate or 0.0) for row in answer.offsets if row.exported)
    assert max(abs(values[row.name] - row.applied) for row in answer.offsets if row.exported) > 0.005
    head = " ".join(told(run, "offsets").head)
    assert "To enter:" in head
    assert f"to enter: {values['delta2']:+.6f} deg" in head
    assert "To enter:" not in " ".join(answer.head)


@pytest.fixture(scope="module")
def to_enter(run: Run) -> RobotCalibration:
    return told(run, "offsets")


@pytest.mark.parametrize("kind", ["rapid", "moc", "kuka", "ur", "fanuc", "epson", "yaskawa"])
def test_every_controller_s_file_has_the_values_to_enter(
    run: Run, to_enter: RobotCalibration, kind: str
) -> None:
    """The estimate is in the head alone, the value in its table too."""
    formats = {each.name: each for maker in makers() for each in maker.offsets}
    names = {"kuka": "kr6_r900", "ur": "ur5e", "fanuc": "lrmate_200id", "yaskawa": "gp8"}
    robot = load_robot(names.get(kind, "irb1600"))
    if kind == "epson":
        robot = replace(robot, vendor="epson")
    if kind == "ur":  # computes with its factory calibration
        arm = run.path.parent / "factory.yaml"
        arm.write_text("# UR5e with the factory calibration of calibration.conf.\n")
        run = replace(run, header=run.header.model_copy(update={"robot": arm.name}))
    text = formats[kind].text(replace(run, robot=robot), to_enter)
    assert "Do ONE of these, never both" in text
    for offset in to_enter.offsets:
        if offset.exported and offset.row.estimate is not None:
            assert offset.applied != offset.row.estimate
            assert text.count(f"{offset.row.estimate:+.6f}") == 1
            value = f"{offset.applied:.6f}"
            assert text.count(value) >= 2


@pytest.mark.long
def test_a_program_gets_what_depends_on_the_posture_too(tmp_path: Path) -> None:
    run = geometry_run(tmp_path, gravity=True, harmonics=True)
    answer = told(run, "postures")
    assert answer.left_out == ()
    solution = solve_run(Problem.from_run(run), run.header)
    problem, joints = solution.problem, postures(run.robot)[:5]
    # An offset that rests on what is assumed is not corrected.
    (assumed,) = (offset.row.name for offset in answer.offsets if offset.row.status == "assumed")
    x = solution.fit.x.copy()
    x[problem.parameters.index(assumed)] = 0.0
    arm = x[problem.parameters.arm]
    (place,) = problem.functions.kernel("place")(joints, arm, np.array([60.0, 20.0, 150.0]))
    bent = np.array([row + answer.posture_offsets(row) for row in joints])
    pose = answer.corrected.fk(bent, "rad")
    np.testing.assert_allclose(pose[:, :3, :3] @ [60.0, 20.0, 150.0] + pose[:, :3, 3], place, atol=1e-6)
    assert np.abs(bent - joints).max() > 1e-6


@pytest.mark.long
def test_a_controller_s_file_says_what_it_leaves_out(run: Run) -> None:
    answer = told(run, "offsets")
    text = rapid_text(answer)
    assert "NOT IN THIS FILE" in text
    said = " ".join(line.strip(" !") for line in text.splitlines())
    for own in answer.geometry:
        assert own.status == "held" or own.name in said
    whole, left = answer.rms_mm
    assert left > 10 * whole
    assert f"{left:.3g} mm with what this file holds" in said
    assert "link2.a: +" not in said
    assert csv_text(answer).count("\n") == 7


@pytest.mark.long
def test_gravity_and_harmonics_are_in_no_robot_but_in_the_json(tmp_path: Path) -> None:
    run = geometry_run(tmp_path, gravity=True, harmonics=True)
    answer = told(run)
    names = {own.name for own in answer.left_out}
    assert {"joint3.gravity", "joint3.cos", "joint3.sin"} <= names
    text = robot_text(run, answer)
    assert "joint3.gravity" in text.partition("NOT IN THIS FILE")[2]
    assert "joint3.gravity: +" not in text
    data = json.loads(json_text(told(run, "all")))
    rows = {row["name"]: row for row in data["parameters"]}
    assert rows["joint3.gravity"]["status"] != "held"
    known = [name for name, row in rows.items() if row["estimate"] is not None and row["std"] is not None]
    assert data["covariance"]["names"] == known
    matrix = np.array(data["covariance"]["matrix"])
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), [rows[name]["std"] for name in known], rtol=1e-9)
    assert np.linalg.eigvalsh(matrix).min() > 0
    assert not any(
        row["estimate"] or row["std"] for row in rows.values() if row["status"] == "unidentifiable"
    )


def test_nominal_geometry_says_nothing_of_links(tmp_path: Path) -> None:
    run = geometry_run(tmp_path, values={})
    nominal = Run(
        run.header.model_copy(update={"geometry": "exact"}), run.robot, run.shots, run.lines,
        run.path, run.sha256, run.warnings, run.header_line,
    )  # fmt: skip
    answer = told(nominal)
    assert answer.geometry == answer.left_out == ()
    assert "link" not in " ".join(answer.head)


def test_what_a_robot_file_states_besides_its_rows_stays(tmp_path: Path) -> None:
    rows = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    (tmp_path / "arm.yaml").write_text(f"{rows}bodies: {{radius_mm: 77}}\npayload_kg: 7.5\n", "utf-8")
    run = arm_run(tmp_path, robot="irb1600")
    arm = load_robot("arm.yaml", tmp_path)
    run = replace(run, robot=arm, header=run.header.model_copy(update={"robot": "arm.yaml"}))
    (tmp_path / "out.yaml").write_text(robot_text(run, told(run)), encoding="utf-8")
    stated, written = (stated_rows(name, tmp_path).content for name in ("arm.yaml", "out.yaml"))
    assert written.pop("joints") != stated.pop("joints")
    assert written == stated
    assert load_robot("out.yaml", tmp_path).conventions == arm.conventions


def test_names_that_mean_harm_stay_names(tmp_path: Path) -> None:
    harm = "=" + "".join(c for c in HOSTILE if c.isprintable()) + " 机器人🤖"
    rows = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    rows = rows.replace("name: irb1600", f"name: {json.dumps(harm, ensure_ascii=False)}")
    rows = rows.replace("  - {a_mm: 700", f"  - {{name: {json.dumps(harm, ensure_ascii=False)}, a_mm: 700")
    (tmp_path / "arm.yaml").write_text(rows, encoding="utf-8")
    run = arm_run(tmp_path, robot="irb1600")
    arm = load_robot("arm.yaml", tmp_path)
    run = replace(run, robot=arm, header=run.header.model_copy(update={"robot": "arm.yaml"}))
    answer = told(run)
    (tmp_path / "out.yaml").write_text(robot_text(run, answer), encoding="utf-8")
    (tmp_path / "out.urdf").write_text(urdf_text(run, answer), encoding="utf-8")
    for robot in (load_robot("out.yaml", tmp_path), read_urdf(tmp_path / "out.urdf", "base", "flange")):
        assert (robot.name, robot.joints[1].name) == (harm, harm)
        np.testing.assert_allclose(robot.fk(postures(robot), "rad"), calibrated_poses(run, answer), atol=1e-9)
