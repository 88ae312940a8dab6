"""Calculated poses for the true arm: it comes to where they mean, or nothing is written.

The true arm is `ControllerArm` with known offsets; its nominal one commands it, as a controller does.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, TABLE_2, header, plan_of, simulated, varied_postures
from command_line import zerobeam
from controller_arm import ControllerArm
from export_runs import STATED, saved
from geometry_runs import LINKS, geometry_run
from made_backups import DIALECTS, Dialect, MadeBackup, MadePosition, texts_after, written
from scipy.spatial.transform import Rotation

from zerobeam.experiments import converted_programs
from zerobeam.experiments.command_options import BackupOptions, ReachOptions, ZeroOptions
from zerobeam.experiments.converted_programs import kept_programs, reached_programs
from zerobeam.experiments.makers import calibration
from zerobeam.experiments.positions import arm_change
from zerobeam.experiments.positions.conversion import Conversion
from zerobeam.experiments.validated_solution import NotValidated
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.output.terminal import page_text
from zerobeam.reports.positions_page import positions_page, write_conversion

OFFSETS = np.array([0.0, -0.4, 0.3, 0.3, -0.5, 0.6])  # deg
TARGET = (500.0, 0.0, 200.0)
EXACT = {"joint_deg": 1e-6, "spot_mm": 1e-4}  # offsets to 5e-5 deg: 0.0009 mm at 1 m each
USUAL = {"joint_deg": 0.01, "spot_mm": 0.05}
RAPID = DIALECTS["RAPID"]
SEEDS = range(12)


def measured(
    folder: Path,
    robot: str,
    *,
    noise: dict[str, float] = EXACT,
    count: int = 10,
    seed: int = 1,
    tool: dict[str, Any] = STATED,
    **more: Any,
) -> Path:
    """A run of an arm with OFFSETS and links as nominal, which does not say that it is simulated."""
    own = header(tool, robot=robot, target=TARGET, **{**more, **noise})
    arm = load_robot(robot)
    plan = plan_of(own, varied_postures(own, arm, TARGET, count, 5), robot=arm)
    values = {f"delta{i}": float(value) for i, value in enumerate(OFFSETS, start=1) if value}
    folder.mkdir(parents=True, exist_ok=True)
    return Path(saved(folder, own, simulated(plan, values, seed)[1]).path)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("runs")
    return cache(lambda language: measured(folder / language, DIALECTS[language].robot))


def reached(folder: Path, run: Path, allowed: ReachOptions | None = None, **choices: Any) -> Conversion:
    return reached_programs(folder, run, BackupOptions(**choices), allowed or ReachOptions())


def misses(backup: MadeBackup, texts: dict[str, str], offsets: Matrix = OFFSETS) -> Matrix:
    """(N, 2) mm and deg by which the tool of the true arm is off the place that each pose means."""
    nominal = backup.dialect.arm
    true = replace(nominal, offsets=offsets)
    rows = []
    for one, reading in zip(backup.positions, backup.readings(texts, -OFFSETS), strict=True):
        if one.in_joints:
            continue
        tool = backup.tools[one.tool]
        meant, there = nominal.fk(one.joints, "deg") @ tool, true.fk(reading, "deg") @ tool
        turn = Rotation.from_matrix(meant[:3, :3].T @ there[:3, :3]).magnitude()
        rows.append([np.linalg.norm(meant[:3, 3] - there[:3, 3]), np.degrees(turn)])
    return np.array(rows)


def with_poses(language: str, seed: int) -> MadeBackup:
    backup = DIALECTS[language].made(seed)
    return backup if not all(one.in_joints for one in backup.positions) else with_poses(language, seed + 100)


@pytest.mark.one_in(3)
@pytest.mark.at_length(r"-(?:[3-9]|1\d)$")
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("language", DIALECTS)
def test_the_true_arm_comes_to_the_place_that_a_pose_means(
    language: str, seed: int, runs: Callable[[str], Path], tmp_path: Path
) -> None:
    backup = with_poses(language, seed)
    answer = reached(written(backup, tmp_path), runs(language), **backup.options)
    assert (answer.refused, answer.to_state, answer.open_lines) == ((), (), [])
    after = texts_after(backup, answer)
    off = misses(backup, after)
    assert (off <= [0.01, backup.dialect.turn_digit]).all()
    # Unconverted it is not there, nor with offsets of the other sign.
    assert (misses(backup, backup.texts)[:, 0] > 1).all()
    assert (misses(backup, after, -OFFSETS)[:, 0] > 1).all()


@pytest.mark.parametrize("language", ["RAPID", "KRL", "TP"])
def test_positions_in_joints_stay(language: str, runs: Callable[[str], Path], tmp_path: Path) -> None:
    made = (DIALECTS[language].made(seed) for seed in range(100))
    backup = next(one for one in made if len({each.in_joints for each in one.positions}) == 2)
    answer = reached(written(backup, tmp_path / "b"), runs(language), **backup.options)
    after = texts_after(backup, answer)
    for row in answer.positions:
        stays = row.kind == "joints"
        assert (row.after is None, row.moved_mm is None) == (stays, stays)
    for one in backup.positions:
        same = backup.dialect.found(one, after) == backup.dialect.found(one, backup.texts)
        assert same == one.in_joints
    write_conversion(tmp_path / "new", answer)
    assert "in joints: taught, they stay" in (tmp_path / "new" / "positions.html").read_text()


def only_joints() -> MadeBackup:
    made = (RAPID.made(seed, count=1) for seed in range(100))
    return next(one for one in made if one.positions[0].in_joints)


def test_a_backup_with_positions_in_joints_alone_is_refused(
    runs: Callable[[str], Path], tmp_path: Path
) -> None:
    backup = only_joints()
    answer = reached(written(backup, tmp_path), runs("RAPID"), **backup.options)
    assert not answer.converted
    (refusal,) = answer.refused
    assert refusal.sentence.startswith("all positions are in joints")


def single(joints: list[float], dialect: Dialect = RAPID) -> MadeBackup:
    """A module with one robtarget."""
    one = MadePosition("P1", np.array(joints), "tool0", "wobj0", in_joints=False)
    backup = MadeBackup(dialect, {"tool0": np.eye(4)}, {"wobj0": np.eye(4)}, [one])
    backup.texts = dialect.texts(backup, np.random.default_rng(0))
    return backup


GOOD = [10.0, 20.0, 15.0, 30.0, 40.0, 50.0]
FAR_OFF = (0.2, 0.05)  # mm, deg: twenty times what is allowed, and more


@pytest.mark.one_in(3)
@pytest.mark.parametrize("seed", range(3))
def test_with_usual_noise_it_is_off_by_what_the_estimate_leaves(seed: int, tmp_path: Path) -> None:
    run = measured(tmp_path / "run", RAPID.robot, seed=seed, noise=USUAL)
    judged = calibration.calibration(read_run(run), holds="postures")
    order = [judged.covariance.names.index(f"delta{i}") for i in range(2, 7)]
    covariance = np.array(judged.covariance.matrix)[np.ix_(order, order)]
    backup = with_poses("RAPID", seed)
    answer = reached(written(backup, tmp_path / "b"), run)
    off = misses(backup, texts_after(backup, answer))
    bounds = [place_u(one.joints, backup.tools[one.tool], covariance) for one in backup.positions]
    bounds = [u for u, one in zip(bounds, backup.positions, strict=True) if not one.in_joints]
    stated = [row.uncertainty_mm for row in answer.positions if row.kind == "cartesian"]
    np.testing.assert_allclose(sorted(stated), sorted(2 * np.array(bounds)), rtol=1e-4)
    assert (off[:, 0] < 4 * np.array(bounds) + 0.01).all()
    # Not because the bound is wide: unconverted it is off by several times that.
    assert misses(backup, backup.texts)[:, 0].mean() > 5 * np.mean(bounds)


def place_u(joints: Matrix, tool: Matrix, covariance: Matrix) -> float:
    """Standard uncertainty, mm, of the tool's place by offsets 2 to 6 (5, 5), deg²."""
    steps = joints + 1e-3 * np.eye(6)[1:]
    places = np.array([(RAPID.arm.fk(row, "deg") @ tool)[:3, 3] for row in [joints, *steps]])
    jacobian = (places[1:] - places[0]).T / 1e-3
    return float(np.sqrt(np.trace(jacobian @ covariance @ jacobian.T)))


def test_what_bends_with_the_posture_is_made_up_for() -> None:
    """`reached` alone: links, offsets and a deflection that depends on the commanded joints."""
    nominal = load_robot("irb120")
    links = [replace(joint, fixed=joint.fixed @ _small(i)) for i, joint in enumerate(nominal.joints)]
    offsets = np.radians(OFFSETS)
    linked = replace(nominal, joints=tuple(links))

    def bending(joints: Matrix) -> Matrix:
        return np.asarray(np.radians([0, 0.1, 0.05, 0, 0.02, 0]) * np.sin(joints))

    change, undo = arm_change.reached(nominal, linked.with_offsets(offsets), offsets, bending)
    true = ControllerArm.of(linked, OFFSETS)
    for joints in np.random.default_rng(1).uniform(-15, 15, (20, 6)) + GOOD:
        commanded = change(joints)
        bent = np.degrees(bending(np.radians(commanded)))
        meant = RAPID.arm.fk(joints, "deg")
        assert np.abs(true.fk(commanded + bent, "deg") - meant).max() < 1e-5
        assert np.abs(true.fk(commanded, "deg") - meant).max() > 1e-2
        assert np.abs(undo(commanded) - joints).max() < 1e-6


def _small(number: int) -> Matrix:
    """(4, 4): 0.3 mm and 0.05 deg, another way for each link."""
    rng, pose = np.random.default_rng(number), np.eye(4)
    pose[:3, 3] = 0.3 * rng.normal(size=3)
    pose[:3, :3] = Rotation.from_rotvec(np.radians(0.05) * rng.normal(size=3)).as_matrix()
    return pose


class LargeRapid(type(RAPID)):  # type: ignore[misc]
    """Of an IRB 1600, in front and with the elbow up, where the sides are those of the small one."""

    robot = "irb1600"


@pytest.mark.long
def test_links_are_made_up_for_too(tmp_path: Path) -> None:
    run = geometry_run(tmp_path)
    backup = single(GOOD, LargeRapid())
    options = ReachOptions(allow_weak=True, allow_assumed=True)
    answer = reached(written(backup, tmp_path / "b"), run.path, options)
    problem = Problem.from_run(run)
    names = [row.name for row in calibration.calibration(run, allow_weak=True, allow_assumed=True).geometry]
    links = np.array([LINKS.get(name, 0.0) for name in names])
    angles = [name.endswith(("alpha", "beta", "theta")) for name in names]
    true = problem.geometry.applied(run.robot, np.where(angles, np.radians(links), links))
    offsets = np.array([TABLE_2.get(f"delta{i}", 0.0) for i in range(1, 7)])
    reading_by_offsets = backup.positions[0].joints - offsets
    arm = ControllerArm.of(true, offsets)
    meant = backup.dialect.arm.fk(backup.positions[0].joints, "deg")
    (reading,) = backup.readings(texts_after(backup, answer), -offsets)
    apart = [
        np.linalg.norm(arm.fk(row, "deg")[:3, 3] - meant[:3, 3]) for row in (reading, reading_by_offsets)
    ]
    # The probe's place is assumed, and the posture is none that was measured.
    assert apart[0] < 0.4
    assert apart[1] > 1


# Refused, and what would be written without the check


def require_off(backup: MadeBackup, answer: Conversion) -> None:
    assert answer.converted
    assert (misses(backup, texts_after(backup, answer)) > FAR_OFF).any()


def test_a_degenerate_run_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    along_axis_6 = {**STATED, "direction": [0, 0, 1]}
    run, backup = measured(tmp_path / "run", RAPID.robot, tool=along_axis_6), single(GOOD)
    folder = written(backup, tmp_path / "b")
    with pytest.raises(BadInput, match="the data do not determine it"):
        reached(folder, run)
    monkeypatch.setattr(calibration, "_require_known", lambda *_, **__: None)
    require_off(backup, reached(folder, run))


def test_an_assumed_offset_is_refused(tmp_path: Path) -> None:
    """The laser is 1 deg off about axis 6, which nobody has measured."""
    turned = {**LASER, "direction": [float(np.cos(np.radians(1))), float(np.sin(np.radians(1))), 0.0]}
    run = measured(tmp_path / "run", RAPID.robot, tool=turned)
    first, rest = run.read_text().split("\n", 1)
    run.write_text("\n".join([json.dumps({**json.loads(first), "tool": LASER}), rest]))
    backup = single(GOOD)
    folder = written(backup, tmp_path / "b")
    with pytest.raises(BadInput, match="delta6 is not known"):
        reached(folder, run)
    allowed = reached(folder, run, ReachOptions(allow_assumed=True))
    require_off(backup, allowed)
    assert any("ASSUMED" in note for note in allowed.notes)
    without = reached(folder, run, ReachOptions(without=["delta6"]))
    assert any(note.startswith("delta6") and "EXCLUDED on request" in note for note in without.notes)
    # On the last axis joint 6 moves no place; elsewhere nothing is known of it.
    for answer in (allowed, without):
        assert [row.uncertainty_mm is None for row in answer.positions] == [False]
    beside = {"new_tools": ["tool0=30,0,100,1,0,0,0"]}
    for options in (ReachOptions(allow_assumed=True), ReachOptions(without=["delta6"])):
        answer = reached(folder, run, options, **beside)
        assert [row.uncertainty_mm for row in answer.positions] == [None]
        assert "U is not known where" in page_text(positions_page(answer))
    known = replace_offset(5, 0.0)
    assert (misses(backup, texts_after(backup, without), known) < (0.01, 0.001)).all()


def replace_offset(joint: int, value: float) -> Matrix:
    offsets = OFFSETS.copy()
    offsets[joint] = value
    return offsets


def test_a_misfit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, backup = measured(tmp_path / "run", RAPID.robot), single(GOOD)
    folder = written(backup, tmp_path / "b")
    assert reached(folder, run).converted
    first, second, *rest = run.read_text().splitlines()
    shot = json.loads(second)
    shot["joints_deg"][1] += 0.5
    run.write_text("\n".join([first, json.dumps(shot), *rest]) + "\n")
    with pytest.raises(NotValidated, match="the poses move a robot"):
        reached(folder, run)
    unasked = partial(calibration.calibration, unvalidated=True)
    monkeypatch.setattr(converted_programs, "calibration", unasked)
    require_off(backup, reached(folder, run))


def test_a_weak_offset_is_refused(tmp_path: Path) -> None:
    run, backup = measured(tmp_path / "run", RAPID.robot, count=4, noise=USUAL), single(GOOD)
    folder = written(backup, tmp_path / "b")
    with pytest.raises(BadInput, match="weakly observable"):
        reached(folder, run)
    require_off(backup, reached(folder, run, ReachOptions(allow_weak=True)))


def test_a_simulated_run_is_refused(tmp_path: Path) -> None:
    folder = written(single(GOOD), tmp_path / "b")
    run = measured(tmp_path / "run", RAPID.robot, provenance={"origin": "simulated"})
    with pytest.raises(BadInput, match="the run is simulated"):
        reached(folder, run)
    with pytest.raises(BadInput, match="the run is simulated"):
        kept_programs(folder, ZeroOptions(run=run), BackupOptions())
    real = measured(tmp_path / "real", RAPID.robot, provenance={"origin": "cell 4"})
    assert reached(folder, real).converted
    assert kept_programs(folder, ZeroOptions(run=real), BackupOptions()).converted


def test_joint_5_near_zero_is_refused(
    runs: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backups = {bent: single([*GOOD[:4], bent, 50]) for bent in (0.3, -0.3, 40.0)}
    folders = {bent: written(backup, tmp_path / str(bent)) for bent, backup in backups.items()}
    sentences = {0.3: "joint 5 is at 0.300 deg", -0.3: "the arm would reach it in another configuration"}
    for bent, sentence in sentences.items():
        answer = reached(folders[bent], runs("RAPID"))
        assert answer.content == {}
        assert sentence in answer.refused[0].sentence
    # Without the check the wrist of one folds to its other side; that of the good one does not.
    monkeypatch.setattr(arm_change.ArmChange, "_require_regular", lambda *_: None)
    assert [folds(backups[bent], reached(folders[bent], runs("RAPID"))) for bent in (-0.3, 40.0)] == [
        True,
        False,
    ]


def folds(backup: MadeBackup, answer: Conversion) -> bool:
    texts = (backup.texts, texts_after(backup, answer))
    before, after = (RAPID.found(backup.positions[0], each)[1] for each in texts)
    return bool(before[3] != after[3])


def test_joint_6_that_the_run_cannot_tell_is_said_to_stay(tmp_path: Path) -> None:
    """With a laser whose direction is not known, a turn of joint 6 is one of the laser."""
    backup = single(GOOD)
    run = measured(tmp_path / "run", RAPID.robot, tool={**LASER, "calibrated": False})
    answer = reached(written(backup, tmp_path / "b"), run)
    ((off_mm, off_deg),) = misses(backup, texts_after(backup, answer))
    assert off_mm < 0.01
    assert off_deg == pytest.approx(abs(OFFSETS[5]), abs=0.001)
    assert any(note.startswith("Joint 6 is not corrected") for note in answer.notes)
    known = reached(tmp_path / "b", measured(tmp_path / "known", RAPID.robot))
    assert not any(note.startswith("Joint 6 is not corrected") for note in known.notes)


def test_a_position_beyond_the_limits_is_refused(
    runs: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backup = single([10.0, 109.9, -60.0, 30.0, 40.0, 50.0])
    folder = written(backup, tmp_path / "b")
    answer = reached(folder, runs("RAPID"))
    assert answer.content == {}
    assert "once converted joint 2 is at 110." in answer.refused[0].sentence
    monkeypatch.setattr(arm_change.ArmChange, "_require_reachable", lambda *_: None)
    (reading,) = backup.readings(texts_after(backup, reached(folder, runs("RAPID"))), -OFFSETS)
    assert reading[1] > np.degrees(load_robot(RAPID.robot).upper[1])


def test_a_second_conversion_is_refused(
    runs: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backup = with_poses("RAPID", 3)
    answer = reached(written(backup, tmp_path / "backup"), runs("RAPID"))
    write_conversion(tmp_path / "new", answer)
    with pytest.raises(BadInput, match="converted before"):
        reached(tmp_path / "new", runs("RAPID"))
    monkeypatch.setattr(converted_programs, "require_not_converted", lambda *_: None)
    twice = reached(tmp_path / "new", runs("RAPID"))
    require_off(backup, twice)
    assert (misses(backup, texts_after(backup, answer)) <= (0.01, 0.001)).all()


def test_as_typed(runs: Callable[[str], Path], tmp_path: Path) -> None:
    backup = with_poses("TP", 2)
    folder, new = written(backup, tmp_path / "backup"), tmp_path / "new"
    answer = zerobeam("positions", "reach", folder, "--run", runs("TP"), "-o", new)
    assert answer.status == 0
    said = " ".join(answer.out.split())
    assert "elsewhere than before. With the wrong sign it would be off by twice that." in said
    assert "Convert the whole backup" not in said
    assert "HELD at 0, not estimated" in said
    after = backup.texts | {"WORK.LS": (new / "WORK.LS").read_bytes().decode("latin-1")}
    assert (misses(backup, after) <= (0.01, backup.dialect.turn_digit)).all()
